"""A mesh of two cells, samples on it, and evaluations with known figures."""

import numpy as np
import pytest

from mixpinn.evaluation import VirtualTopology
from mixpinn.records import Evaluation, SampleTable, TissueMesh


@pytest.fixture(scope="session")
def two_cells() -> TissueMesh:
    """Two tetrahedra; node 0 is soft, nodes 1 and 2 are part A, nodes 3 and 4 part B: two rigid edges, 1-2 and 3-4."""
    points = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 2], [3, 4, 2]])
    cells = np.array([[0, 1, 2, 3], [1, 4, 2, 3]], dtype=np.int32)
    mesh = TissueMesh(
        points, cells, np.array([0, 1, 1, 2, 2], dtype=np.int16), np.array([True, False, False, False, False]),
        ("vertebrae_A", "vertebrae_B"), np.zeros(2, dtype=np.int16),
    )
    assert (mesh.cell_volumes > 0.0).all()
    return mesh


@pytest.fixture(scope="session")
def virtual() -> VirtualTopology:
    """A virtual node at the centre of each part, nodes 5 and 6, joined to the part's nodes."""
    return VirtualTopology(
        np.array([[1.5, 2.0, 0.0], [1.5, 2.0, 2.0]]), np.array([1, 2]), np.array([[1, 5], [2, 5], [3, 6], [4, 6]]),
    )


@pytest.fixture
def table(two_cells: TissueMesh) -> SampleTable:
    """Six samples at three positions and two depths; node 4 is the contact node."""
    generator = np.random.default_rng(5)
    count = 6
    return SampleTable(
        mesh_hash=two_cells.hash(), position_index=np.repeat([0, 1, 2], 2), rotation_deg=np.zeros(count),
        depth=np.tile([1.0, 2.0], 3), probe_translation=np.tile([1.5, 4.0, 1.0], (count, 1)),
        probe_rotation=np.tile(np.eye(3), (count, 1, 1)), contact_offsets=np.arange(count + 1),
        contact_nodes=np.full(count, 4), contact_forces=np.ones((count, 3)), probe_wrench=np.zeros((count, 6)),
        displacement=generator.normal(size=(count, 5, 3)).astype(np.float32),
    )


def make_evaluation(model: str, scale: float) -> Evaluation:
    """Four positions with depths 1 … 5 mm; MEE is `scale` times the depth, plus a tenth of the position."""
    position, depth = np.repeat(np.arange(4.0), 5), np.tile(np.arange(1.0, 6.0), 4)
    mee = scale * depth + 0.1 * position
    names = {"mee": 1.0, "mae": 0.5, "mse": 0.25, "rigid_mee": 0.8, "soft_mee": 1.1, "ree": 0.05}
    metrics = {name: factor * mee for name, factor in names.items()}
    metrics["mean_displacement"] = 2.0 * depth
    return Evaluation(
        model, "test", metrics, {"position": position, "rotation": np.zeros(20), "depth": depth},
        {"soft": 1.1 * mee, "vertebrae_L1": 0.8 * mee}, np.full(20, 0.012), {"threads": 2},
    )


@pytest.fixture
def evaluations() -> tuple[Evaluation, ...]:
    """Predicting no motion, and two models of which MIXPINN is the better one."""
    return make_evaluation("No motion", 2.0), make_evaluation("Simple GAT", 0.55), make_evaluation("MIXPINN", 0.2)
