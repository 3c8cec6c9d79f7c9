"""The training stage: its run directory explains itself, and refuses another run."""

from dataclasses import replace
from pathlib import Path

import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json
from mixpinn.base.rundir import is_finished
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.stages.network_training import train_stage
from mixpinn.training import TrainConfig
from training.toy_block import TINY, block_mesh

CONFIG = TrainConfig(max_epochs=1, threads=1)


def test_the_run_directory_explains_itself_and_is_extended(
    tmp_path: Path, mesh: TissueMesh, table: SampleTable, validation: SampleTable,
) -> None:
    def stage(config: TrainConfig) -> None:
        train_stage(
            tmp_path, TINY, config, mesh=mesh, table_train=table, table_validation=validation, accelerator="cpu",
        )

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
        train_stage(
            tmp_path / "out", TINY, CONFIG, mesh=block_mesh(1.0), table_train=table, table_validation=validation,
        )
    assert not (tmp_path / "out").exists()
