import numpy as np
import pytest

from mixpinn.graph import part_diameters, rigid_reach
from mixpinn.records import SampleTable, TissueMesh


def chain(n=14):
    """Consecutive cells share three nodes, so that node i is joined to i ± 1, 2 and 3: k nodes on need ⌈k / 3⌉ hops."""
    turn = np.arange(n) * 2.0
    points = np.column_stack([np.cos(turn), np.sin(turn), 0.5 * np.arange(n)])
    cells = np.arange(n - 3)[:, None] + np.arange(4)
    part = np.zeros(n, dtype=np.int16)
    part[2:], part[:2] = 1, 2
    return TissueMesh(
        points, cells.astype(np.int32), part, np.zeros(n, dtype=bool), ("A", "B"), np.zeros(n - 3, dtype=np.int16),
    )


def test_hops_are_counted_along_a_chain_of_cells():
    assert part_diameters(chain()) == {"A": 4, "B": 1}


def test_layers_reach_three_nodes_each_from_the_contact():
    mesh = chain()
    contacts = (np.array([0]), np.array([6, 13]))
    table = SampleTable(
        mesh.hash(), np.arange(2), np.zeros(2), np.ones(2), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)),
        np.array([0, 1, 3]), np.concatenate(contacts), np.ones((3, 3)), np.zeros((2, 6)),
        np.zeros((2, 14, 3), dtype=np.float32),
    )
    # All fourteen nodes are rigid. Two layers lead from node 0 to node 6, and from nodes 6 and 13 to every other.
    assert rigid_reach(mesh, table, 2) == pytest.approx((7 / 14 + 14 / 14) / 2)


def test_short_cuts_through_soft_tissue_count(two_cells):
    # Nodes 0 and 4 of the part are not joined, but have neighbours in common.
    assert part_diameters(two_cells) == {"A": 2}
