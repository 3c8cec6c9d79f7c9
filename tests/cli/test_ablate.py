"""The paper's experiments at toy size through the command line: killed, gone on with, and repeated elsewhere."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from pipeline.chain import command, contents, done

PATIENCE = 180.0
SETTINGS = {
    "rows": ["row-1", "row-10"], "repeated": [], "seeds": [3], "few_positions": [2], "hidden": 4, "passes": 24,
    "deepest_seen": 2.0, "unseen_rotations": [], "other_probe": {"rotations": [0.0]},
}


def words(chain, folder, out):
    settings = folder / "ablate.json"
    settings.write_text(json.dumps(SETTINGS))
    return [
        "ablate", str(chain.simulation), "--protocol", "desk", "--config", str(settings), "--workers", "2", "--out",
        str(out),
    ]


@pytest.fixture(scope="module")
def whole(chain, tmp_path_factory):
    """A table that was never interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    done(*words(chain, folder, folder / "table"))
    return folder / "table"


def results(folder):
    return json.loads((folder / "results.json").read_text())


def means(folder):
    """Every figure of every run but the times."""
    return {(run["row"], run["seed"], run["positions"]): run["means"] for run in results(folder)["runs"]}


def test_every_row_and_both_baselines_stand_in_every_table(whole):
    found = results(whole)
    assert {run["row"] for run in found["runs"]} == {"no-motion", "elastic-prior", "row-1", "row-10"}
    names = [entry["name"] for entry in found["test_sets"]]
    assert names == ["test", "deep", "noise", "probe"]
    for entry in found["test_sets"]:
        assert entry["samples"] >= entry["poses"] >= entry["positions"] > 0
    for run in found["runs"]:
        assert list(run["means"]) == names
    tables = {table["title"]: table for table in found["tables"]}
    for name in names:
        rows = [row[0] for row in tables[f"Test set “{name}”"]["rows"]]
        assert rows == ["No motion", "Elastic prior", "Row 1 (simple GAT)", "Row 10 (MIXPINN)"]
    assert (whole / "results.md").read_text().count("| No motion |") == len(names) + 3
    assert (whole / "rows.png").stat().st_size > 10_000


def test_held_out_depths_are_not_trained_on(whole):
    from mixpinn.records import SampleTable

    parts = {name: SampleTable.load(whole / "samples" / name) for name in ("train", "validation", "test", "deep")}
    assert all(parts[name].depth.max() <= 2.0 for name in ("train", "validation", "test"))
    assert parts["deep"].depth.min() > 2.0
    positions = [set(parts[name].position_index.tolist()) for name in ("train", "validation", "test")]
    assert not positions[0] & positions[1]
    assert not (positions[0] | positions[1]) & positions[2]


def test_fewer_positions_get_more_epochs_for_the_same_budget(whole):
    runs = {run["positions"]: run["training"] for run in results(whole)["runs"] if run["row"] == "row-10"}
    passes = {count: training["samples"] * training["epochs"] for count, training in runs.items()}
    assert runs[2]["samples"] < runs[None]["samples"]
    assert all(abs(value - 24) <= runs[count]["samples"] / 2 for count, value in passes.items())


def test_killed_table_goes_on_to_the_same_figures(chain, whole, tmp_path):
    out = tmp_path / "table"
    given = words(chain, tmp_path, out)
    process = subprocess.Popen(
        [sys.executable, "-m", "mixpinn.cli", *given], start_new_session=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + PATIENCE
    while not list((out / "rows").glob("*/history.csv")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert not (out / "results.json").exists()
    done(*given)
    assert means(out) == means(whole)


def test_finished_table_trains_nothing_again(chain, whole, tmp_path):
    before = {name: data for name, data in contents(whole).items() if name.startswith(("rows/", "evaluations/"))}
    done(*words(chain, tmp_path, whole))
    assert {name: data for name, data in contents(whole).items() if name in before} == before


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (("--row", "row-14"), "row-14"), (("--protocol", "kitchen"), "desk, paper"),
        (("--set", "seeds=[0, 1]"), "another config"), (("--set", "few_positions=[99]"), "few_positions"),
        (("--scheduler", "tcp://127.0.0.1:1"), "Dask scheduler"),
    ],
)
def test_bad_requests_are_refused_in_one_line(chain, whole, tmp_path, extra, said):
    given = words(chain, tmp_path, whole if "config" in said else tmp_path / "table")
    outcome = command(*given, *extra)
    assert outcome.code == 2
    assert said in outcome.lines[-1]
