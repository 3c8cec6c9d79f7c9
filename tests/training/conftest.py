"""Fixtures of the toy problem."""

import pytest

from mixpinn.records import SampleTable, TissueMesh
from training.toy_block import block_mesh, block_table


@pytest.fixture(scope="session")
def mesh() -> TissueMesh:
    """The block."""
    return block_mesh()


@pytest.fixture(scope="session")
def table(mesh: TissueMesh) -> SampleTable:
    """Ten training samples."""
    return block_table(mesh, 10)


@pytest.fixture(scope="session")
def validation(mesh: TissueMesh) -> SampleTable:
    """Three validation samples."""
    return block_table(mesh, 3, seed=1)
