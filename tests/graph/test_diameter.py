import numpy as np

from mixpinn.graph import part_diameters
from mixpinn.records import TissueMesh


def test_hops_are_counted_along_a_chain_of_cells():
    # Consecutive cells share three nodes, so that node i is joined to i ± 1, 2 and 3: k nodes on need ⌈k / 3⌉ hops.
    n = 14
    turn = np.arange(n) * 2.0
    points = np.column_stack([np.cos(turn), np.sin(turn), 0.5 * np.arange(n)])
    cells = np.arange(n - 3)[:, None] + np.arange(4)
    part = np.zeros(n, dtype=np.int16)
    part[2:], part[:2] = 1, 2
    mesh = TissueMesh(
        points, cells.astype(np.int32), part, np.zeros(n, dtype=bool), ("A", "B"), np.zeros(n - 3, dtype=np.int16),
    )
    assert part_diameters(mesh) == {"A": 4, "B": 1}


def test_short_cuts_through_soft_tissue_count(two_cells):
    # Nodes 0 and 4 of the part are not joined, but have neighbours in common.
    assert part_diameters(two_cells) == {"A": 2}
