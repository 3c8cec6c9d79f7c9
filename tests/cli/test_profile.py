"""The run-time table at toy size through the command line."""

import json

import pytest

from pipeline.chain import command, done

SETTINGS = {
    "models": ["row-1"], "hidden": 4, "repeats": 6,
    "simulation": {"protocol": {
        "rotations": [0.0], "approach": 0.5, "step": 1.0, "steps": 3, "start": "touch", "max_positions": 1,
    }},
}


@pytest.fixture(scope="module")
def profiled(chain, tmp_path_factory):
    folder = tmp_path_factory.mktemp("profile")
    settings = folder / "profile.json"
    settings.write_text(json.dumps(SETTINGS))
    words = ["profile", str(chain.mesh), "--config", str(settings), "--out", str(folder / "table")]
    done(*words)
    return folder / "table", words


def test_every_method_is_timed_with_what_a_reader_must_know(profiled):
    folder, _ = profiled
    rows = {row["method"]: row for row in json.loads((folder / "results.json").read_text())["timings"]}
    assert list(rows) == ["fem", "elastic-prior", "row-1"]
    for row in rows.values():
        assert (row["threads"], row["mesh"]) == (1, "mesh")
        assert row["device"] in {"cpu", "cuda"}
        assert 0.0 < row["median_ms"] <= row["p95_ms"]
        assert row["nodes"] > 100
        # An edge has two directions, and a cell mesh more edges than nodes.
        assert row["edges"] % 2 == 0
        assert row["edges"] > 2 * row["nodes"]
    assert rows["row-1"]["repeats"] == 6
    assert set(rows["row-1"]["by_depth_ms"]) == set(rows["fem"]["by_depth_ms"])
    assert (folder / "cost.png").stat().st_size > 5_000
    assert "| Finite elements, one step |" in (folder / "results.md").read_text()


def test_what_is_measured_is_not_measured_again(profiled):
    folder, words = profiled
    path = folder / "timings" / "mesh-row-1.json"
    kept = json.loads(path.read_text())
    (folder / "timings" / "mesh-elastic-prior.json").unlink()
    done(*words)
    assert json.loads(path.read_text()) == kept
    assert (folder / "timings" / "mesh-elastic-prior.json").exists()


@pytest.mark.parametrize(
    ("extra", "said"),
    [(("--model", "row-20"), "row-20"), (("--repeats", "0"), "repeats"), (("--threads", "2"), "another config")],
)
def test_bad_requests_are_refused_in_one_line(profiled, extra, said):
    _, words = profiled
    outcome = command(*words, *extra)
    assert outcome.code == 2
    assert said in outcome.lines[-1]
