"""Bad stores, models, contacts and settings at the command line: one line, exit code 2, nothing half-written."""

import json
import shutil

import numpy as np
import pytest
import pyvista as pv

from cli.refusal import refused
from mixpinn.records import TissueMesh
from mixpinn.stages.seal import seal_folder
from pipeline.chain import contents


class TestStore:
    @pytest.fixture
    def store(self, chain, tmp_path):
        shutil.copytree(chain.simulation, tmp_path / "s")
        return tmp_path / "s"

    @pytest.fixture(params=["dataset", "train", "evaluate"])
    def refuses(self, request, chain, tmp_path):
        out = tmp_path / "out"
        words = {"dataset": [], "train": ["--out", out], "evaluate": [chain.model, "--out", out]}[request.param]
        return lambda folder, says: refused(request.param, folder, *words, says=says, out=out)

    def test_missing(self, refuses, tmp_path):
        refuses(tmp_path / "absent", ["absent", "no store.json"])

    def test_truncated_pose(self, store, refuses):
        path = store / "store" / "pose_001_000" / "displacement" / "c" / "2" / "0" / "0"
        path.write_bytes(path.read_bytes()[:-7])
        refuses(store, ["pose_001_000", "truncated", "mixpinn simulate"])

    def test_altered_pose(self, store, refuses):
        path = store / "store" / "pose_001_000" / "displacement" / "c" / "2" / "0" / "0"
        content = bytearray(path.read_bytes())
        content[-3] ^= 255
        path.write_bytes(bytes(content))
        refuses(store, "pose_001_000")

    def test_pose_that_is_not_simulated(self, store, refuses):
        (store / "store" / "status" / "pose_004_000.json").unlink()
        refuses(store, ["pose_004_000", "mixpinn simulate"])

    def test_truncated_record(self, store, refuses):
        path = store / "store" / "store.json"
        path.write_text(path.read_text()[:-50])
        refuses(store, "store.json")

    def test_record_without_poses(self, store, refuses):
        (store / "store" / "store.json").write_text("{}")
        refuses(store, "store.json")

    def test_foreign_mesh(self, store, refuses):
        path = store / "store" / "mesh.vtu"
        mesh = pv.read(path)
        mesh.points[0] += 0.01
        mesh.save(path)
        refuses(store, "mesh.vtu")

    def test_missing_mesh(self, store, refuses):
        (store / "store" / "mesh.vtu").unlink()
        refuses(store, "mesh.vtu")


class TestTrain:
    @pytest.mark.parametrize(("words", "says"), [
        (["--model", "resnet"], ["model 'resnet'", "physgnn"]), (["--width", "huge"], ["huge", "tiny"]),
        (["--scaling", "robust"], ["scaling", "'standard'"]), (["--epochs", "-1"], "max_epochs"),
        (["--devices", "0"], "devices"), (["--set", "train.batchsize=3"], ["train.batchsize", "batch_size"]),
        (["--set", "train.learning_rate=fast"], "train.learning_rate"), (["--set", "train"], "KEY=VALUE"),
    ])
    def test_bad_settings(self, chain, tmp_path, words, says):
        refused("train", chain.simulation, "--out", tmp_path / "out", *words, says=says, out=tmp_path / "out")


def reseal(folder):
    """Write the manifest anew, as a careful vandal would."""
    (folder / "manifest.json").unlink()
    seal_folder(folder)


class TestModel:
    @pytest.fixture
    def model(self, chain, tmp_path):
        shutil.copytree(chain.model, tmp_path / "m")
        return tmp_path / "m"

    @pytest.fixture(params=["evaluate", "predict"])
    def refuses(self, request, chain, tmp_path):
        out = tmp_path / "out"

        def check(model, says, store=chain.simulation):
            words = ["evaluate", store, model, "--out", out]
            if request.param == "predict":
                words = ["predict", model, "--simulations", store, "--out", out / "p.vtu"]
            refused(*words, says=says, out=out)

        return check

    def test_missing(self, refuses, tmp_path):
        refuses(tmp_path / "absent", "absent")

    def test_truncated_weights(self, model, refuses):
        path = model / "weights.safetensors"
        path.write_bytes(path.read_bytes()[:-20])
        refuses(model, "weights.safetensors")

    def test_weights_of_another_network(self, model, refuses):
        description = json.loads((model / "model.json").read_text())
        description["config"]["layers"] += 1
        (model / "model.json").write_text(json.dumps(description))
        reseal(model)
        refuses(model, "weights.safetensors")

    def test_unknown_setting(self, model, refuses):
        description = json.loads((model / "model.json").read_text())
        description["config"]["colour"] = 1
        (model / "model.json").write_text(json.dumps(description))
        reseal(model)
        refuses(model, "colour")

    def test_mesh_of_another_topology(self, model, refuses):
        mesh = pv.read(model / "mesh.vtu")
        mesh.point_data["part"][:] = 0
        mesh.save(model / "mesh.vtu")
        reseal(model)
        refuses(model, ["a model of linear tetrahedra", "choose the model"])

    def test_dataset_of_another_mesh(self, chain, model, refuses, tmp_path):
        store = tmp_path / "s"
        shutil.copytree(chain.simulation, store)
        grid = TissueMesh.load(chain.mesh / "mesh.vtu").grid()
        grid.points[0] += 0.01
        grid.save(store / "store" / "mesh.vtu")
        record = json.loads((store / "store" / "store.json").read_text())
        record["mesh_hash"] = TissueMesh.load(store / "store" / "mesh.vtu").hash()
        (store / "store" / "store.json").write_text(json.dumps(record))
        reseal(store / "store")
        refuses(model, "mesh", store)


class TestPredict:
    @pytest.mark.parametrize(("words", "says"), [
        ([], "one of --contacts, --simulations and --tip"), (["--position", "77", "--simulations"], "position 77"),
        (["--depth", "9", "--simulations"], "9 mm"),
    ])
    def test_bad_sample(self, chain, tmp_path, words, says):
        words = [*words, chain.simulation] if words else []
        refused("predict", chain.model, "--out", tmp_path / "out" / "p.vtu", *words, says=says, out=tmp_path / "out")

    @pytest.mark.parametrize("text", ["1e308,0,0", "0,-10001,0", "0,nan,0", "1,2"])
    def test_tip(self, chain, tmp_path, text):
        out = tmp_path / "out"
        refused("predict", chain.model, f"--tip={text}", "--out", out / "p.vtu", says=f"got '{text}'", out=out)

    @pytest.mark.parametrize("text", ["node,dx,dy,dz\n99999,0,0,0\n", "1,2\n", "", "1,0,nan,0\n"])
    def test_bad_contacts(self, chain, tmp_path, text):
        (tmp_path / "contacts.csv").write_text(text)
        refused(
            "predict", chain.model, "--contacts", tmp_path / "contacts.csv", "--out", tmp_path / "out" / "p.vtu",
            says="expected", out=tmp_path / "out",
        )

    def test_format(self, chain, tmp_path):
        refused(
            "predict", chain.model, "--simulations", chain.simulation, "--out", tmp_path / "out" / "p.docx",
            says=".stl", out=tmp_path / "out",
        )

    def test_output_that_is_a_folder(self, chain, tmp_path):
        (tmp_path / "p.vtu").mkdir()
        refused(
            "predict", chain.model, "--simulations", chain.simulation, "--out", tmp_path / "p.vtu", says="a folder",
        )
        assert not contents(tmp_path)

    def test_output_over_a_file_of_the_model(self, chain):
        before = (chain.model / "mesh.vtu").read_bytes()
        refused(
            "predict", chain.model, "--simulations", chain.simulation, "--out", chain.model / "mesh.vtu",
            says="a file of a trained network",
        )
        assert (chain.model / "mesh.vtu").read_bytes() == before

    def test_ids_that_are_one_number(self, chain, tmp_path):
        np.savez(tmp_path / "contacts.npz", nodes=3, displacements=[0.0, -1.0, 0.0])
        refused(
            "predict", chain.model, "--contacts", tmp_path / "contacts.npz", "--out", tmp_path / "p.vtu",
            says="contact nodes",
        )


@pytest.mark.parametrize("words", [
    ["anatomy", "", "--out", "out"], ["anatomy", "phantom", "--out", ""], ["mesh", "anatomy", "--out="],
    ["mesh", " ", "--out", "out"],
])
def test_words_of_a_variable_that_is_not_set(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    refused(*words, says="variables of the shell")
    assert not contents(tmp_path)


@pytest.mark.parametrize("words", [["anatomy", "LONG"], ["anatomy", "phantom", "--out", "LONG"], ["mesh", "LOOP"]])
def test_paths_that_the_system_refuses(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loop").symlink_to("loop")
    words = [{"LONG": "n" * 300, "LOOP": "loop"}.get(word, word) for word in words]
    refused(*words, *([] if "--out" in words else ["--out", "out"]), says="check the path")
    assert not contents(tmp_path)


class TestSettings:
    @pytest.mark.parametrize(("text", "says"), [
        ("[mesh\nsize = 2", "TOML"), ("[mesh]\nsise = 2", ["mesh.sise", "size"]), ("mesh = 3", "mesh"),
        ("[mesh]\nsize = 'big'", "mesh.size"), ("[models]\nnames = ['resnet']", "resnet"),
        ("[models]\nwidth = 'huge'", "huge"), ("[anatomy]\nsource = 'dicom'", "anatomy.source"),
        ("[anatomy]\nsource = 'folder'", "path"),
    ])
    def test_bad_file(self, tmp_path, text, says):
        (tmp_path / "run.toml").write_text(text)
        refused("run", tmp_path / "run.toml", "--out", tmp_path / "out", says=says)

    @pytest.mark.parametrize("text", ["[1, 2]", "3", "{"])
    def test_bad_json(self, tmp_path, text):
        (tmp_path / "run.json").write_text(text)
        refused("run", tmp_path / "run.json", "--out", tmp_path / "out", says="run.json", out=tmp_path / "out")

    def test_absent_file_and_folder(self, tmp_path):
        refused("run", tmp_path / "absent.toml", "--out", tmp_path / "out", says="no such file")
        refused("run", tmp_path, "--out", tmp_path / "out", says=str(tmp_path))


@pytest.mark.parametrize("stage", ["anatomy", "mesh", "simulate", "train"])
@pytest.mark.parametrize("below", [False, True])
def test_output_that_is_a_file(chain, tmp_path, stage, below):
    (tmp_path / "out").write_text("precious")
    out = tmp_path / "out" / "below" if below else tmp_path / "out"
    refused(*chain.words(stage, out=out), says=["out", "existing file"])
    assert (tmp_path / "out").read_text() == "precious"


@pytest.mark.parametrize("words", [
    ["mesh", "absent"], ["simulate", "absent"], ["simulate", "absent.vtu"], ["export", "sofa", "absent"],
    ["import", "sofa", "absent", "--mesh", "absent.vtu", "--positions", "absent.txt"],
])
def test_missing_sources(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    refused(*words, "--out", tmp_path / "out", says="absent", out=tmp_path / "out")
