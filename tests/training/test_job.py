"""A job refuses samples of another mesh, and its identity is that of its parts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.training import TrainingSettings
from mixpinn.training.job import TrainingJob
from training.toy_block import TINY, block_mesh


def test_samples_of_another_mesh_or_none_are_refused(mesh: TissueMesh, table: SampleTable) -> None:
    with pytest.raises(InputError, match="training samples: expected samples of linear tetrahedra"):
        TrainingJob(TINY, TrainingSettings(), block_mesh(1.0), table, table, Path("out"))
    none = table.select(np.array([], dtype=np.int64))
    with pytest.raises(InputError, match="validation samples: expected at least one sample"):
        TrainingJob(TINY, TrainingSettings(), mesh, table, none, Path("out"))


def test_the_identity_leaves_out_limits_only(mesh: TissueMesh, table: SampleTable, validation: SampleTable) -> None:
    def identity(config: TrainingSettings, validation: SampleTable = validation, hidden: int = 8) -> dict[str, object]:
        return TrainingJob(replace(TINY, hidden=hidden), config, mesh, table, validation, Path("out")).identity()

    base = identity(TrainingSettings())
    assert identity(TrainingSettings(max_epochs=3, time_budget=1.0, threads=1)) == base
    others = [
        identity(TrainingSettings(seed=1)), identity(TrainingSettings(batch_size=2)),
        identity(TrainingSettings(), table), identity(TrainingSettings(), hidden=4),
    ]
    assert all(other != base for other in others)
