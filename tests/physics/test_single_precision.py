"""The material in single precision is that of the solver's kernels in double precision."""

import numpy as np

from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics import quadratic_tetrahedron
from mixpinn.physics.energies import STABLE
from mixpinn.physics.linear_tetrahedron import cell_forces
from mixpinn.physics.quadrature import TETRAHEDRON_4
from mixpinn.physics.single_precision import LANES, add_quadratic_stable_forces, add_stable_forces, in_lanes


def in_single(cells, moved, gradients, mu, lam, volumes):
    """The operands of the kernels: all but `moved` in lanes."""
    constants = np.stack([mu, lam, volumes], axis=1).astype(np.float32)
    edges = gradients[:, 1:].reshape(-1, 9).astype(np.float32)
    return in_lanes(cells.astype(np.int32)), moved.astype(np.float32), in_lanes(edges), in_lanes(constants)


def test_lanes_hold_the_cells_side_by_side():
    values = np.arange(2 * (LANES + 3)).reshape(-1, 2)
    lanes = in_lanes(values)
    assert lanes.shape == (2, 2 * LANES)
    np.testing.assert_array_equal(lanes[0, LANES:], values[:LANES, 1])
    np.testing.assert_array_equal(lanes[1, :LANES], [*values[LANES:, 0], *[0] * (LANES - 3)])


def test_both_kernels_state_one_law():
    rng = np.random.default_rng(4)
    points = 10.0 * rng.normal(size=(40, 3))
    cells = np.array([rng.permutation(40)[:4] for _ in range(60)])
    gradients, volumes = shape_gradients(points, cells)
    moved = 0.5 * rng.normal(size=(40, 3))
    mu, lam = rng.uniform(5e-3, 2e-2, 60), rng.uniform(5e-2, 2e-1, 60)
    each = np.empty((60, 4, 3))
    cell_forces(0, 60, cells, moved, gradients, volumes, np.full(60, STABLE), mu, lam, each)
    expected = np.zeros((40, 3))
    np.add.at(expected, cells, each)
    found = np.zeros((40, 3), np.float32)
    add_stable_forces(*in_single(cells, moved, gradients, mu, lam, volumes), found)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_ten_node_cells_have_the_forces_of_the_solver():
    rng = np.random.default_rng(5)
    points = 10.0 * rng.normal(size=(60, 3))
    cells = np.array([rng.permutation(60)[:10] for _ in range(50)])
    gradients, volumes = shape_gradients(points, cells[:, :4])
    moved = 0.3 * rng.normal(size=(60, 3))
    mu, lam = rng.uniform(5e-3, 2e-2, 50), rng.uniform(5e-2, 2e-1, 50)
    rule = TETRAHEDRON_4.points, TETRAHEDRON_4.weights
    each = np.empty((50, 10, 3))
    quadratic_tetrahedron.cell_forces(
        0, 50, cells, moved, gradients, volumes, *rule, np.full(50, STABLE), mu, lam, each,
    )
    expected = np.zeros((60, 3))
    np.add.at(expected, cells, each)
    found = np.zeros((60, 3), np.float32)
    add_quadratic_stable_forces(*in_single(cells, moved, gradients, mu, lam, volumes), found)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
