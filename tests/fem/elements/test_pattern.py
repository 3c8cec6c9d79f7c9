import numpy as np

from mixpinn.fem.elements.pattern import NodePairs, Reduction, incidence


def test_incidence_lists_positions_by_target():
    offsets, entries = incidence(np.array([2, 0, 2, 3]), 4)
    assert offsets.tolist() == [0, 1, 1, 3, 4]
    assert entries.tolist() == [1, 0, 2, 3]


def test_pairs_of_one_cell_and_an_extra_one():
    pairs = NodePairs.build(6, np.array([[0, 1, 2, 4]]), np.array([[5, 0], [1, 0], [3, 3]]))
    found = [divmod(code, 6) for code in pairs.codes.tolist()]
    assert found == [(0, 1), (0, 2), (0, 4), (0, 5), (1, 2), (1, 4), (2, 4)]
    neighbours = [pairs.nodes[a:b].tolist() for a, b in zip(pairs.offsets[:-1], pairs.offsets[1:], strict=True)]
    assert neighbours == [[1, 2, 4, 5], [0, 2, 4], [0, 1, 4], [], [0, 1, 2], [0]]
    assert pairs.ids[pairs.offsets[4]:pairs.offsets[5]].tolist() == [2, 5, 6]
    # The cell's six blocks are those of its pairs in order; the extra pair has none.
    assert np.diff(pairs.cell_offsets).tolist() == [1, 1, 1, 0, 1, 1, 1]
    assert pairs.cell_entries.tolist() == [0, 1, 2, 3, 4, 5]
    ids, known = pairs.find(np.array([5, 3, 3]), np.array([0, 3, 4]))
    assert known.tolist() == [True, True, False]
    assert ids[0] == 3


def test_pattern_of_soft_fixed_and_rigid_nodes():
    # Nodes 0, 2 free, 1 fixed, 3 rigid; all coupled: unknowns 0-2 (node 0), 3-5 (node 2), 6-11 (the part).
    pairs = NodePairs.build(4, np.array([[0, 1, 2, 3]]), np.empty((0, 2), dtype=int))
    reduction = Reduction.build(pairs, np.array([0, 0, 0, 1]), np.array([False, True, False, False]), 1)
    assert reduction.n_dofs == 12
    assert reduction.soft_index.tolist() == [0, -1, 1, -1]
    rows = np.split(reduction.indices, reduction.indptr[1:-1])
    assert [row.tolist() for row in rows] == [list(range(i, 12)) for i in range(12)]
    # Column offsets behind the diagonal block: node 0 → 2 at 0, → 3 at 3; node 2 → 3 at 0; the others have no block.
    offsets = [reduction.entry_offset[a:b].tolist() for a, b in zip(pairs.offsets[:-1], pairs.offsets[1:], strict=True)]
    assert offsets == [[-1, 0, 3], [-1, -1, -1], [-1, -1, 0], [-1, -1, -1]]


def test_uncoupled_unknowns_are_not_stored():
    cells = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
    pairs = NodePairs.build(8, cells, np.empty((0, 2), dtype=int))
    part = np.array([0, 0, 0, 0, 0, 0, 0, 1])
    reduction = Reduction.build(pairs, part, np.zeros(8, dtype=bool), 1)
    rows = np.split(reduction.indices, reduction.indptr[1:-1])
    assert rows[0].tolist() == list(range(12))
    assert rows[12].tolist() == list(range(12, 27))
