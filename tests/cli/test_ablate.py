"""The paper's experiments at toy size through the command line: killed and continued, and repeated elsewhere."""

import json
import subprocess
import sys
import time

import pytest

from children import PATIENCE
from mixpinn.dataset import dask_pool
from mixpinn.records import SampleTable
from pipeline.chain import command, contents, done

SETTINGS = {
    "models": ["row-10"], "repeated": [], "seeds": [3], "few_positions": [2], "hidden": 4, "physgnn_hidden": 4,
    "passes": 12, "deepest_seen": 2.0, "unseen_rotations": [], "other_probe": {"rotations": [0.0]},
}


def words(chain, folder, out, **settings):
    path = folder / "ablate.json"
    path.write_text(json.dumps(SETTINGS | settings))
    return [
        "ablate", str(chain.simulation), "--protocol", "desk", "--config", str(path), "--workers", "2", "--out",
        str(out),
    ]


@pytest.fixture(scope="module")
def table(chain, tmp_path_factory):
    """A table whose trainings were killed when the first had an epoch, and then continued."""
    folder = tmp_path_factory.mktemp("ablate")
    given, out = words(chain, folder, folder / "table"), folder / "table"
    process = subprocess.Popen(
        [sys.executable, "-m", "mixpinn.cli", *given], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + PATIENCE
    while not list((out / "rows").glob("*/history.csv")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.kill()  # alone: its workers must see for themselves that it is gone
    process.communicate()
    assert not (out / "results.json").exists()
    done(*given)
    return out


@pytest.fixture
def scheduler():
    """Address of a Dask scheduler with a worker inside this process."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50,
    ) as cluster:
        yield cluster.scheduler_address


def results(folder):
    return json.loads((folder / "results.json").read_text())


def means(folder):
    """Every figure of every run but the times."""
    return {(run["row"], run["seed"], run["positions"]): run["means"] for run in results(folder)["runs"]}


def test_every_row_and_both_baselines_stand_in_every_table(table):
    found = results(table)
    assert {run["row"] for run in found["runs"]} == {"no-motion", "elastic-prior", "row-10"}
    names = [entry["name"] for entry in found["test_sets"]]
    assert names == ["test", "deep", "noise", "probe"]
    for entry in found["test_sets"]:
        assert entry["samples"] >= entry["poses"] >= entry["positions"] > 0
    for run in found["runs"]:
        assert list(run["means"]) == names
    tables = {entry["title"]: entry for entry in found["tables"]}
    for name in names:
        rows = [row[0] for row in tables[f"Test set “{name}”"]["rows"]]
        assert rows == ["No motion", "Elastic prior", "Row 10 (MIXPINN)"]
        assert f"### Test set “{name}”" in (table / "results.md").read_text()
    assert (table / "rows.png").stat().st_size > 10_000


def test_held_out_depths_are_not_trained_on(table):
    parts = {name: SampleTable.load(table / "samples" / name) for name in ("train", "validation", "test", "deep")}
    assert all(parts[name].depth.max() <= 2.0 for name in ("train", "validation", "test"))
    assert parts["deep"].depth.min() > 2.0
    positions = [set(parts[name].position_index.tolist()) for name in ("train", "validation", "test")]
    assert not positions[0] & positions[1]
    assert not (positions[0] | positions[1]) & positions[2]


def test_fewer_positions_get_more_epochs_for_the_same_budget(table):
    runs = {run["positions"]: run["training"] for run in results(table)["runs"] if run["row"] == "row-10"}
    passes = {count: training["samples"] * training["epochs"] for count, training in runs.items()}
    assert runs[2]["samples"] < runs[None]["samples"]
    assert all(abs(value - SETTINGS["passes"]) <= runs[count]["samples"] / 2 for count, value in passes.items())


def test_uninterrupted_table_on_other_workers_has_the_same_figures(chain, table, scheduler, tmp_path):
    done(*words(chain, tmp_path, tmp_path / "table"), "--scheduler", scheduler)
    repeated, first = means(tmp_path / "table"), means(table)
    assert list(repeated) == list(first)
    for run, test_sets in first.items():
        for name, figures in test_sets.items():
            # Other processes: the last digits of matrix products may differ between them.
            assert repeated[run][name] == pytest.approx(figures, rel=1e-3, abs=1e-9)


def test_finished_table_trains_nothing_again(chain, table, tmp_path):
    before = {name: data for name, data in contents(table).items() if name.startswith(("rows/", "evaluations/"))}
    done(*words(chain, tmp_path, table))
    assert {name: data for name, data in contents(table).items() if name in before} == before


def test_tables_of_finished_runs_need_no_source(chain, table, tmp_path):
    before = results(table)["tables"]
    given = words(chain, tmp_path, table)
    given[1] = "nowhere"
    done(*given, "--tables-only")
    assert results(table)["tables"] == before
    outcome = command(*given, "--tables-only", "--hidden", "5")
    assert outcome.code == 2
    assert "these settings" in outcome.lines[-1]


def test_training_that_diverges_leaves_the_others_their_table(chain, scheduler, tmp_path):
    given = words(
        chain, tmp_path, tmp_path / "table", models=["row-10", "physgnn"], few_positions=[], physgnn_learning_rate=1e30,
        other_probe=None,
    )
    outcome = command(*given, "--scheduler", scheduler)
    assert outcome.code == 2
    assert "physgnn-seed-3" in outcome.lines[-1]
    assert "diverged" in outcome.lines[-1]
    assert {run["row"] for run in results(tmp_path / "table")["runs"]} == {"no-motion", "elastic-prior", "row-10"}


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (("--model", "row-14"), "row-14"), (("--protocol", "kitchen"), "desk, paper"),
        (("--set", "seeds=[0, 1]"), "another config"), (("--set", "few_positions=[99]"), "few_positions"),
        (("--scheduler", "tcp://127.0.0.1:1"), "Dask scheduler"), (("--devices", "0"), "devices"),
    ],
)
def test_bad_requests_are_refused_in_one_line(chain, table, tmp_path, monkeypatch, extra, said):
    monkeypatch.setattr(dask_pool, "_CONNECT", "1s")
    given = words(chain, tmp_path, table if "config" in said else tmp_path / "table")
    outcome = command(*given, *extra)
    assert outcome.code == 2
    assert said in outcome.lines[-1]
