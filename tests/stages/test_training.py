import shutil

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.dataset import SimulationStore, Split
from mixpinn.graph import Scaling
from mixpinn.networks import MODELS
from mixpinn.stages.training import ModelsConfig, SplitConfig, load_samples
from mixpinn.training import PHYSGNN_TRAINING, TrainConfig


def test_physgnn_takes_the_settings_of_its_authors_unless_told_otherwise():
    config = ModelsConfig(train=TrainConfig(max_epochs=7))
    assert config.training("mixpinn") == TrainConfig(max_epochs=7)
    own = config.training("physgnn")
    assert (own.learning_rate, own.batch_size) == (PHYSGNN_TRAINING.learning_rate, PHYSGNN_TRAINING.batch_size)
    assert own.max_epochs == 7
    told = ModelsConfig(train=TrainConfig(learning_rate=1e-3, batch_size=2)).training("physgnn")
    assert (told.learning_rate, told.batch_size) == (1e-3, 2)


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
