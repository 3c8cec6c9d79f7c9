"""A trained model's folder on the toy mesh, made once."""

from pathlib import Path

import pytest
import torch

from mixpinn.networks import build_graph_for, build_model, save_checkpoint
from mixpinn.records import SampleTable, TissueMesh
from training.toy_block import TINY, block_mesh, block_table


@pytest.fixture(scope="session")
def mesh() -> TissueMesh:
    """The block."""
    return block_mesh()


@pytest.fixture(scope="session")
def table(mesh: TissueMesh) -> SampleTable:
    """Four samples."""
    return block_table(mesh, 4)


@pytest.fixture(scope="session")
def folder(mesh: TissueMesh, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model folder."""
    folder = tmp_path_factory.mktemp("model")
    model = build_model(TINY, build_graph_for(TINY, mesh), seed=4)
    with torch.no_grad():
        save_checkpoint(folder, model, TINY, mesh)
    return folder
