"""Every verb at toy size, through the real command line."""

import json
import shutil

import numpy as np
import pytest
import pyvista as pv

from mixpinn.base.rundir import is_finished
from mixpinn.dataset import SimulationStore
from mixpinn.records import LabelMap, TissueMesh
from pipeline.chain import RUN, command, contents, done


def test_every_stage_leaves_a_folder_that_explains_itself(chain):
    for folder, stage in (
        (chain.anatomy, "anatomy"), (chain.mesh, "mesh"), (chain.simulation, "simulate"), (chain.model, "train"),
    ):
        record = json.loads((folder / "run.json").read_text())
        assert record["stage"] == stage
        assert record["versions"]["mixpinn"]
        assert is_finished(folder)
    label_map = LabelMap.load(chain.anatomy / "labels.nii.gz")
    mesh = TissueMesh.load(chain.mesh / "mesh.vtu")
    assert label_map.rigid_names == mesh.rigid_names == ("vertebrae_L1", "vertebrae_L2")
    assert (mesh.cell_volumes > 0).all()
    store = SimulationStore.open(chain.simulation / "store", mesh=mesh)
    assert [status.state for status in store.statuses()] == ["done"] * 6
    assert (chain.model / "weights.safetensors").is_file()


@pytest.mark.parametrize("stage", ["anatomy", "mesh", "simulate", "train"])
def test_same_command_again_keeps_what_there_is(chain, stage):
    folder = chain.words(stage)[-1]
    kept = {"labels.nii.gz", "mesh.vtu", "store/store.json", "store/pose_000_000/displacement/c/0/0/0",
            "weights.safetensors"}
    before = {name: (folder / name).stat().st_mtime_ns for name in kept if (folder / name).exists()}
    assert before
    done(*chain.words(stage))
    assert {name: (folder / name).stat().st_mtime_ns for name in before} == before


@pytest.mark.parametrize(("stage", "change"), [
    ("anatomy", "phantom.torso_width=190"), ("mesh", "size=5"), ("simulate", "protocol.steps=2"),
    ("train", "train.batch_size=2"),
])
def test_other_settings_in_the_same_folder_are_refused(chain, stage, change):
    folder = chain.words(stage)[-1]
    before = contents(folder)
    outcome = command(*chain.words(stage), "--set", change)
    assert outcome.code == 2
    assert "a run with another config" in outcome.lines[-1]
    assert contents(folder) == before


def test_dataset_prints_its_table_where_results_go(chain):
    outcome = done("dataset", chain.simulation)
    assert "6" in outcome.out
    assert "Positions" not in outcome.err


def test_run_goes_on_from_the_stages_that_are_there(chain):
    before = (chain.model / "weights.safetensors").stat().st_mtime_ns
    words = ["run", chain.settings("run"), "--out", chain.root, "--threads", "1"]
    done(*words)
    assert (chain.model / "weights.safetensors").stat().st_mtime_ns == before
    report = chain.root / "evaluation" / "report.html"
    assert "Toy" in report.read_text()
    results = json.loads((chain.root / "run.json").read_text())["results"]["mee"]
    assert results["No motion"] > results["Elastic prior"] > 0.0
    assert set(json.loads((chain.root / "stage_seconds.json").read_text())) - {"sha256"} == {
        "Anatomy", "Mesh", "Simulation", "Training mixpinn", "Evaluation",
    }
    written = report.stat().st_mtime_ns
    done(*words)
    assert report.stat().st_mtime_ns == written


def test_demo_with_settings_of_its_own(chain, tmp_path):
    for stage in ("anatomy", "mesh", "simulation"):
        shutil.copytree(chain.root / stage, tmp_path / stage)
    settings = {**RUN, "evaluation": {"pictures": False}}
    settings["models"] = {
        **RUN["models"], "scaling": "none",
        "train": {"max_epochs": 1, "learning_rate": 5e-4, "time_budget": None, "threads": 1},
    }
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={json.dumps(value)}")]
    done("demo", "--out", tmp_path, "--threads", "1", *words)
    assert (tmp_path / "evaluation" / "report.html").is_file()
    assert (tmp_path / "models" / "mixpinn" / "weights.safetensors").is_file()


def test_evaluate_writes_tables_and_report(chain, tmp_path):
    words = ["evaluate", chain.simulation, chain.model, "--out", tmp_path / "e", "--no-pictures", "--threads", "1"]
    done(*words)
    written = {path.name for path in (tmp_path / "e").iterdir()}
    assert {"run.json", "report.html", "results.json", "results.csv", "results.md"} <= written
    assert len([name for name in written if name.startswith("evaluation-")]) == 4


def test_predict_writes_meshes_that_can_be_read_again(chain, tmp_path):
    sample = ["--simulations", chain.simulation, "--position", "2", "--threads", "1"]
    done("predict", chain.model, "--out", tmp_path / "deformed.vtu", *sample)
    mesh = TissueMesh.load(chain.mesh / "mesh.vtu")
    grid = pv.read(tmp_path / "deformed.vtu")
    np.testing.assert_allclose(grid.points, mesh.points + grid.point_data["displacement"], atol=1e-4)
    assert np.abs(grid.point_data["displacement"]).max() > 0.0
    assert (tmp_path / "deformed.vtu").is_file()
    done("predict", chain.model, "--out", tmp_path / "deformed.stl", *sample)
    surface = pv.read(tmp_path / "deformed.stl")
    assert surface.n_cells == len(mesh.boundary_faces)

    nodes = np.flatnonzero(np.linalg.norm(grid.point_data["reference"], axis=1) > 0.1)[:3]
    rows = [f"{node},0,-1.5,0" for node in nodes]
    (tmp_path / "contacts.csv").write_text("node,dx,dy,dz\n" + "\n".join(rows))
    done("predict", chain.model, "--out", tmp_path / "own.ply", "--contacts", tmp_path / "contacts.csv")
    assert pv.read(tmp_path / "own.ply").n_points > 0
