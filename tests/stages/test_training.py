"""The training stage: settings, samples, and a run directory that explains itself and refuses another run."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json
from mixpinn.base.rundir import is_finished
from mixpinn.dataset import SimulationStore, Split
from mixpinn.graph import Scaling
from mixpinn.networks import MODELS
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.stages.samples import SplitConfig, load_samples
from mixpinn.stages.training import ModelsConfig, train_network
from mixpinn.training import TrainConfig
from training.toy_block import TINY, block_mesh

CONFIG = TrainConfig(max_epochs=1, threads=1)


def test_every_model_can_be_asked_for():
    config = ModelsConfig(names=tuple(MODELS), scaling=Scaling.STANDARD)
    assert all(config.model(name).scaling is Scaling.STANDARD for name in MODELS)


@pytest.mark.parametrize("settings", [{"names": ("resnet",)}, {"width": "huge"}])
def test_unknown_names_are_refused_at_once(settings):
    with pytest.raises(InputError, match=r"resnet|huge"):
        ModelsConfig(**settings)


@pytest.fixture
def store(chain):
    return SimulationStore.open(chain.simulation / "store")


def test_each_sample_belongs_to_one_part(store):
    table, split = load_samples(store, SplitConfig())
    parts = [table.at_positions(positions) for positions in split.parts.values()]
    assert sum(map(len, parts)) == len(table)
    found = [set(part.position_index.tolist()) for part in parts]
    assert all(found)
    assert not (found[0] & found[1] | found[0] & found[2] | found[1] & found[2])


def test_split_of_a_file_is_used_and_an_empty_part_refused(store, tmp_path):
    Split("own", np.array([0, 1, 2]), np.array([3]), np.array([4, 5])).save(tmp_path / "split.json")
    _, split = load_samples(store, SplitConfig(file=str(tmp_path / "split.json")))
    assert split.test.tolist() == [4, 5]
    Split("none", np.array([0, 1, 2]), np.array([3]), np.array([], dtype=np.int64)).save(tmp_path / "none.json")
    with pytest.raises(InputError, match="test part of the split"):
        load_samples(store, SplitConfig(file=str(tmp_path / "none.json")))


def test_unfinished_simulations_are_refused(store, tmp_path):
    shutil.copytree(store.folder, tmp_path / "store")
    (tmp_path / "store" / "status" / "pose_005_000.json").unlink()
    with pytest.raises(InputError, match="1 poses missing, the first pose_005_000"):
        load_samples(SimulationStore.open(tmp_path / "store"), SplitConfig())


def test_the_run_directory_explains_itself_and_is_extended(
    tmp_path: Path, mesh: TissueMesh, table: SampleTable, validation: SampleTable,
) -> None:
    def stage(config: TrainConfig) -> None:
        train_network(mesh, table, validation, TINY, config, out=tmp_path, accelerator="cpu")

    stage(CONFIG)
    assert is_finished(tmp_path)
    names = {"run.json", "model.json", "weights.safetensors", "mesh.vtu", "state.safetensors", "history.csv"}
    assert names <= {path.name for path in tmp_path.iterdir()}
    record = read_json(tmp_path / "run.json")
    assert record["config"]["model"]["hidden"] == TINY.hidden
    assert record["config"]["training"]["learning_rate"] == 5e-4
    assert record["inputs"]["mesh"] == mesh.hash()
    assert record["results"]["limits"]["max_epochs"] == 1
    stage(replace(CONFIG, max_epochs=2))
    assert read_json(tmp_path / "run.json")["results"]["epochs"] == 2
    with pytest.raises(InputError, match="another config"):
        stage(replace(CONFIG, learning_rate=1e-3))


def test_bad_samples_leave_nothing_behind(tmp_path: Path, table: SampleTable, validation: SampleTable) -> None:
    with pytest.raises(InputError, match="training samples"):
        train_network(block_mesh(1.0), table, validation, TINY, CONFIG, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
