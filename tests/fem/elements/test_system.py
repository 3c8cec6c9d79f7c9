"""The elastic system: derivatives, invariance, and how unknowns, nodes and blocks hang together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fem.block_mesh import block, labelled, two_bones
from fem.elements.system_checks import (
    MATERIALS,
    SOFT,
    check_derivatives,
    check_threads,
    check_user_materials,
    full,
    large_motion,
)
from mixpinn.base.errors import InputError
from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.geometry.rotations import rotation_from_vector

angle = st.floats(-1.5, 1.5, allow_nan=False)


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_energy_gradient_and_tangent_agree(material):
    system = ElasticSystem(two_bones(), [material])
    check_derivatives(system, large_motion(system), directions=5)


@pytest.mark.parametrize("project", [True, False])
def test_materials_of_the_user_and_several_tissues(project):
    mesh = two_bones()
    tissue = np.arange(len(mesh.cells)) % 3
    mesh = labelled(mesh.points, mesh.cells, part=mesh.part, fixed=mesh.fixed, tissue=tissue)
    check_user_materials(mesh, project=project)


def test_results_do_not_depend_on_threads():
    mesh = block((9, 8, 8), shake=0.2)
    check_threads(labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9), scatter=0.01)


def test_tangent_is_the_hessian_of_the_energy_in_the_rotations():
    system, h = ElasticSystem(two_bones(), [SOFT]), 1e-3
    state, last = large_motion(system), np.arange(-12, 0)
    block_ = full(system.tangent(state, project=False))[-12:, -12:]
    units = np.zeros((12, system.n_dofs))
    units[np.arange(12), last] = h

    def energy(increment):
        return system.energy(system.advance(state, increment))

    second = np.array([
        [(energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b)) / (4.0 * h * h) for b in units] for a in units
    ])
    np.testing.assert_allclose(block_, second, atol=1e-5 * np.abs(second).max())


def test_projected_tangent_is_positive_and_exact_one_is_not():
    mesh = block((3, 2, 2))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9)
    system = ElasticSystem(mesh, [SOFT])
    state = system.rest_state()
    state = system.advance(state, 0.25 * np.random.default_rng(0).normal(size=system.n_dofs))
    assert np.linalg.eigvalsh(full(system.tangent(state, project=False)))[0] < 0.0
    assert np.linalg.eigvalsh(full(system.tangent(state)))[0] > 0.0


@settings(max_examples=25, deadline=None)
@given(vector=st.tuples(angle, angle, angle), shift=st.tuples(angle, angle, angle))
@pytest.mark.parametrize("material", MATERIALS[:2], ids=repr)
def test_no_force_under_rigid_motion(material, vector, shift):
    mesh = two_bones((3, 2, 2))
    mesh = labelled(mesh.points, mesh.cells, part=mesh.part)
    system = ElasticSystem(mesh, [material])
    scale = material.mu * 30.0**2  # a stress of μ over a face of the block
    turn = rotation_from_vector(np.array(vector))
    points = mesh.points @ turn.T + 10.0 * np.array(shift)
    centroids = np.array([mesh.points[mesh.part == k].mean(axis=0) for k in (1, 2)])
    state = system.place(points, np.tile(turn, (2, 1, 1)), centroids @ turn.T + 10.0 * np.array(shift) - centroids)
    np.testing.assert_allclose(state.points, points, atol=1e-12)
    assert np.abs(system.gradient(system.rest_state())).max() == 0.0
    assert np.abs(system.gradient(state)).max() <= 1e-12 * scale
    assert abs(system.energy(state)) <= 1e-12 * scale * 30.0
    assert system.min_jacobian(state) == pytest.approx(1.0, abs=1e-12)


@settings(max_examples=10, deadline=None)
@given(vector=st.tuples(angle, angle, angle))
def test_forces_turn_with_the_body(vector):
    system = ElasticSystem(two_bones((3, 2, 2)), [SOFT])
    state, turn = large_motion(system), rotation_from_vector(np.array(vector))
    turned = State(state.points @ turn.T, turn @ state.rotation, state.translation)
    forces = system.gradient(state)
    np.testing.assert_allclose(system.gradient(turned), forces @ turn.T, atol=1e-12 * np.abs(forces).max())
    assert system.energy(turned) == pytest.approx(system.energy(state), rel=1e-12)


def test_external_blocks_reach_soft_rigid_and_fixed_nodes():
    mesh = two_bones()
    soft = np.flatnonzero((mesh.part == 0) & ~mesh.fixed)[[0, 7, -1]]
    first_bone, second_bone = mesh.part_nodes(1)[3], mesh.part_nodes(2)[5]
    held_node = int(np.flatnonzero(mesh.fixed)[0])
    i = np.array([soft[2], soft[0], soft[0], first_bone, first_bone, first_bone, second_bone, soft[1], soft[1]])
    j = np.array([soft[0], soft[0], first_bone, soft[1], first_bone, second_bone, second_bone, held_node, soft[1]])
    values = np.random.default_rng(0).normal(size=(len(i), 3, 3))
    own = i == j
    values[own] += np.swapaxes(values[own], 1, 2)
    system = ElasticSystem(mesh, [SOFT], extra_pairs=np.stack([i, j], axis=1))
    state = large_motion(system)
    nodal = np.zeros_like(mesh.points)
    repeated = [np.concatenate([array, array[:2]]) for array in (i, j, values)]
    without = system.tangent(state, nodal_gradient=nodal)
    added = system.tangent(state, nodal_gradient=nodal, blocks=tuple(repeated)) - without
    external = np.zeros((3 * mesh.n_points, 3 * mesh.n_points))
    for a, b, value in zip(*repeated, strict=True):
        external[3 * a:3 * a + 3, 3 * b:3 * b + 3] += value
        if a != b:
            external[3 * b:3 * b + 3, 3 * a:3 * a + 3] += value.T
    # J column by column, from the linearised motion of the nodes
    motion = np.stack([system.expand(unit, state).ravel() for unit in np.eye(system.n_dofs)], axis=1)
    np.testing.assert_allclose(full(added), motion.T @ external @ motion, atol=1e-10)
    with pytest.raises(InputError, match="extra_pairs"):
        ElasticSystem(mesh, [SOFT]).tangent(state, blocks=(i, j, values))


def test_reduce_is_the_transpose_of_expand():
    system = ElasticSystem(two_bones((3, 2, 2)), [SOFT])
    state, rng = large_motion(system), np.random.default_rng(3)
    nodal, increment = rng.normal(size=state.points.shape), rng.normal(size=system.n_dofs)
    assert system.reduce(nodal, state) @ increment == pytest.approx((nodal * system.expand(increment, state)).sum())


def test_held_unknowns_and_the_pattern():
    system = ElasticSystem(two_bones((3, 2, 2)), [SOFT])
    state, held = large_motion(system), np.zeros(system.n_dofs, dtype=bool)
    held[[0, 7, -12, -1]] = True
    free, fixed = system.tangent(state), system.tangent(state, held=held)
    assert free.indices is not None
    assert np.shares_memory(free.indices, fixed.indices)
    assert free.has_sorted_indices
    expected = full(free)
    expected[held] = expected[:, held] = 0.0
    expected[held, held] = 1.0
    np.testing.assert_array_equal(full(fixed), expected)
    np.testing.assert_array_equal(full(system.hold(free, held)), expected)


def test_difference_undoes_advance():
    system = ElasticSystem(two_bones((3, 2, 2)), [SOFT])
    start, increment = large_motion(system), np.random.default_rng(4).normal(size=system.n_dofs)
    np.testing.assert_allclose(system.difference(start, system.advance(start, increment)), increment, atol=1e-12)


def test_unknowns_of_nodes():
    # Two cells on a triangle of fixed nodes 0, 1, 2; node 3 is free, node 4 a rigid part of its own.
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 1], [0.3, 0.3, -1]], dtype=float)
    cells = np.array([[0, 1, 2, 3], [0, 2, 1, 4]])
    fixed = np.array([True, True, True, False, False])
    system = ElasticSystem(labelled(points, cells, part=np.array([0, 0, 0, 0, 1]), fixed=fixed), [SOFT])
    assert system.n_dofs == 9
    assert system.free_nodes.tolist() == [3]
    assert system.node_dofs(np.array([3, 0, 4])).tolist() == [[0, 1, 2], [-1, -1, -1], [-1, -1, -1]]
    state = system.advance(system.rest_state(), np.array([0, 0, 1.0, 0, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(system.jacobians(state), [2.0, 1.0])
