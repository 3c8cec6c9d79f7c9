import numpy as np

from mixpinn.fem.elements import assembly


def test_forces_and_blocks_are_gathered():
    offsets, entries = np.array([0, 2, 2, 3]), np.array([0, 2, 1])
    forces = np.arange(9.0).reshape(3, 3)
    out = np.full((3, 3), np.nan)
    assembly.gather_forces(0, 3, offsets, entries, forces, out)
    np.testing.assert_array_equal(out, [[6, 8, 10], [0, 0, 0], [3, 4, 5]])
    blocks, out = np.arange(27.0).reshape(3, 9), np.full((3, 9), np.nan)
    assembly.gather_blocks(1, 3, offsets, entries, blocks, out)
    assert np.isnan(out[0]).all()
    np.testing.assert_array_equal(out[1:], [np.zeros(9), np.arange(9.0, 18.0)])


def test_diagonals_make_rows_sum_to_zero():
    # One pair (0, 1): K_00 = −K_01, K_11 = −K_01ᵀ, both made symmetric.
    block = np.random.default_rng(0).normal(size=(1, 3, 3))
    block[0] += block[0].T
    out = np.empty((2, 3, 3))
    assembly.sum_diagonals(0, 2, np.array([0, 1, 2]), np.array([1, 0]), np.array([0, 0]), block, out)
    np.testing.assert_allclose(out, -np.repeat(block, 2, axis=0))


def test_held_rows_and_columns_become_the_identity():
    indptr, indices = np.array([0, 3, 5, 6], dtype=np.int32), np.array([0, 1, 2, 1, 2, 2], dtype=np.int32)
    data = np.array([4.0, 1.0, 2.0, 5.0, 3.0, 6.0])
    assembly.hold_rows(0, 3, np.array([False, True, False]), indptr, indices, data)
    np.testing.assert_array_equal(data, [4.0, 0.0, 2.0, 1.0, 0.0, 6.0])
