"""Ten-node cells in the elastic system: derivatives, invariance, exactness and order of convergence."""

import numpy as np
import pytest
import skfem
from skfem.helpers import ddot, eye, sym_grad, trace

from fem.block_mesh import block, carved, labelled, two_bones
from fem.elements.test_system import UserMaterial, body_force, boundary, equilibrium, full
from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.fem.material.hyperelastic import LinearElastic, StableNeoHookean, StableNeoHookeanLog
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.physics.quadrature import TETRAHEDRON_14
from mixpinn.records.mid_edges import edge_index

SOFT = StableNeoHookean(mu=1.0, lam=4.0)
MATERIALS = [SOFT, StableNeoHookeanLog(mu=1.0, lam=4.0), LinearElastic(mu=1.0, lam=4.0)]


def bones(counts=(6, 3, 3)):
    return carved(two_bones(counts)).with_order(2)


def large_motion(system: ElasticSystem) -> State:
    increment = 0.5 * np.random.default_rng(0).normal(size=system.n_dofs)
    increment[-12:] = [3.0, -2.0, 4.0, 1.3, -0.8, 1.2, -5.0, 1.0, 2.0, -0.4, 1.6, 0.7]
    return system.advance(system.rest_state(), increment)


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_energy_gradient_and_tangent_agree(material):
    system, h = ElasticSystem(bones(), [material]), 1e-4
    state, rng = large_motion(system), np.random.default_rng(1)
    nodal = system.gradient(state)
    residual, tangent = system.reduce(nodal, state), full(system.tangent(state, project=False))
    moment = system.part_wrench(nodal, state)[:, 3:]
    for _ in range(3):
        direction = rng.normal(size=system.n_dofs)
        direction[-12:].reshape(2, 6)[:, 3:] *= 0.1
        ends = [system.advance(state, sign * h * direction) for sign in (1.0, -1.0)]
        slope = (system.energy(ends[0]) - system.energy(ends[1])) / (2.0 * h)
        assert slope == pytest.approx(residual @ direction, rel=1e-6)
        change = np.subtract(*[system.reduce(system.gradient(end), end) for end in ends]) / (2.0 * h)
        change[-12:].reshape(2, 6)[:, 3:] += 0.5 * np.cross(moment, direction[-12:].reshape(2, 6)[:, 3:])
        np.testing.assert_allclose(change, tangent @ direction, atol=1e-6 * np.abs(change).max())


@pytest.mark.parametrize("material", MATERIALS[:2], ids=repr)
def test_no_force_under_rigid_motion(material):
    mesh = bones((3, 2, 2))
    mesh = labelled(mesh.points, mesh.cells, part=mesh.part).with_order(2)
    system = ElasticSystem(mesh, [material])
    turn, shift = rotation_from_vector(np.array([0.9, -1.4, 0.6])), np.array([10.0, -4.0, 7.0])
    points = mesh.node_points @ turn.T + shift
    centroids = np.array([mesh.points[mesh.part == k].mean(axis=0) for k in (1, 2)])
    state = system.place(points, np.tile(turn, (2, 1, 1)), centroids @ turn.T + shift - centroids)
    np.testing.assert_allclose(state.points, points, atol=1e-12)
    assert np.abs(system.gradient(system.rest_state())).max() == 0.0
    assert np.abs(system.gradient(state)).max() <= 1e-12 * material.mu * 30.0**2
    np.testing.assert_allclose(system.jacobians(state), 1.0, atol=1e-12)
    np.testing.assert_allclose(system.vertex_jacobians(state), 1.0, atol=1e-12)


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_affine_patch(material):
    mesh = block((3, 3, 3), shake=0.25).with_order(2)
    system = ElasticSystem(mesh, [material])
    affine = np.array([[0.15, 0.1, -0.05], [0.02, -0.1, 0.08], [0.12, 0.0, 0.05]])
    exact = mesh.node_points @ affine.T
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    outside = ((mesh.node_points < low + 1e-9) | (mesh.node_points > high - 1e-9)).any(axis=1)
    held = np.repeat(outside, 3)
    state, _ = equilibrium(system, system.rest_state(), held, shift=np.where(held, exact.ravel(), 0.0))
    assert np.abs(state.points - mesh.node_points - exact).max() <= 1e-10
    energy = material.energy((np.eye(3) + affine)[None])[0]
    assert system.energy(state) == pytest.approx(energy, rel=1e-10)
    # Under uniform stress vertices inside a face carry nothing and midpoints a third of their faces each.
    stress = material.gradient((np.eye(3) + affine)[None])[0]
    force = system.gradient(state)
    np.testing.assert_allclose(force[mesh.node_points[:, 0] > 1.0 - 1e-9].sum(axis=0) * [1, 0, 0], [0, 0, 0], atol=9.0)
    inner = (mesh.points[:, 0] > 1.0 - 1e-9) & (np.abs(mesh.points[:, 1:] - 0.5) < 0.4).all(axis=1)
    assert np.abs(force[: mesh.n_points][inner]).max() <= 1e-10
    seen = mesh.on_vertices(force)[inner]
    np.testing.assert_allclose(seen, np.tile(stress[:, 0] / 9.0, (len(seen), 1)), atol=1e-10)


def test_a_quadratic_field_bends_the_cells_as_it_should():
    # F is linear within a cell, J cubic: the rule of 14 points integrates the energy of J − 1 to degree 5 at least.
    mesh = block((2, 1, 1), shake=0.0).with_order(2)
    system = ElasticSystem(mesh, [LinearElastic(mu=1.0, lam=1.5)])
    x, y, z = mesh.node_points.T
    moved = 0.1 * np.stack([x * x + y * z, x * y - z * z, y * y + x], axis=1)
    state = State(mesh.node_points + moved, np.empty((0, 3, 3)), np.empty((0, 3)))
    # ε of that field, integrated exactly: W = μ ε:ε + λ/2 (tr ε)², a polynomial of degree 2, by a 3-point Gauss rule
    places, weights = np.polynomial.legendre.leggauss(3)
    grid = np.stack(np.meshgrid(*[0.5 * (places + 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    share = np.einsum("i,j,k->ijk", *[0.5 * weights] * 3).ravel()
    u, v, w = grid.T
    h = 0.1 * np.array([[2 * u, w, v], [v, u, -2 * w], [np.ones_like(u), 2 * v, np.zeros_like(u)]])
    strain = 0.5 * (h + h.transpose(1, 0, 2))
    density = (strain**2).sum(axis=(0, 1)) + 0.75 * np.trace(strain) ** 2
    assert system.energy(state) == pytest.approx(density @ share, rel=1e-12)


def test_linear_elasticity_against_scikit_fem():
    mesh = block((4, 3, 3), size=(2.0, 1.0, 1.0), shake=0.25)
    material = LinearElastic.from_young(3.0, 0.4)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9).with_order(2)
    system = ElasticSystem(mesh, [material])
    load = np.random.default_rng(0).normal(size=mesh.node_points.shape)
    state, _ = equilibrium(
        system, system.rest_state(), np.zeros(system.n_dofs, dtype=bool), load=load, tolerance=1e-9,
    )
    basis = skfem.Basis(
        skfem.MeshTet(mesh.points.T.copy(), mesh.cells.T.astype(np.int64).copy()),
        skfem.ElementVector(skfem.ElementTetP2()), intorder=2,
    )

    @skfem.BilinearForm
    def stiffness(u, v, _):
        strain = sym_grad(u)
        return ddot(2.0 * material.mu * strain + material.lam * eye(trace(strain), 3), sym_grad(v))

    # Its unknowns lie at the vertices and at the midpoints of its own edges.
    unknown = np.concatenate([basis.nodal_dofs.T, basis.edge_dofs.T[np.argsort(edge_index(mesh, basis.mesh.edges.T))]])
    rhs = np.zeros(basis.N)
    rhs[unknown] = load
    solution = skfem.solve(*skfem.condense(stiffness.assemble(basis), rhs, D=unknown[mesh.node_fixed].ravel()))
    expected = solution[unknown]
    assert np.abs(state.points - mesh.node_points - expected).max() <= 1e-8 * np.abs(expected).max()


def test_displacement_converges_with_order_three():
    material, a, errors = LinearElastic(mu=1.0, lam=1.5), np.array([1.0, -0.5, 0.7]), []
    sizes, rule = np.array([2, 4, 6]), TETRAHEDRON_14
    lam = rule.points
    edges = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
    shape = np.concatenate([lam * (2.0 * lam - 1.0), 4.0 * lam[:, edges[:, 0]] * lam[:, edges[:, 1]]], axis=1)
    for n in sizes:
        mesh = block((int(n),) * 3)
        mesh = labelled(mesh.points, mesh.cells, fixed=boundary(mesh)).with_order(2)
        system = ElasticSystem(mesh, [material])
        places = np.einsum("qa,mai->mqi", lam, mesh.points[mesh.cells])
        share = mesh.cell_volumes[:, None] * rule.weights
        load = np.zeros_like(mesh.node_points)
        np.add.at(
            load, mesh.cell_nodes, np.einsum("mqi,qn,mq->mni", body_force(places, a, material), shape, share),
        )
        state, _ = equilibrium(
            system, system.rest_state(), np.zeros(system.n_dofs, dtype=bool), load=load, tolerance=1e-10,
        )
        moved = np.einsum("qn,mni->mqi", shape, (state.points - mesh.node_points)[mesh.cell_nodes])
        error = moved - a * np.sin(np.pi * places).prod(axis=-1)[..., None]
        errors.append(np.sqrt(np.einsum("mqi,mqi,mq->", error, error, share)))
    order = np.log(errors[-2] / errors[-1]) / np.log(sizes[-1] / sizes[-2])
    assert 2.8 <= order <= 3.2


@pytest.mark.parametrize("project", [True, False])
def test_materials_of_the_user_and_several_tissues(project):
    mesh, stiff = carved(two_bones()), StableNeoHookean(mu=3.0, lam=20.0)
    tissue = np.arange(len(mesh.cells)) % 3
    mesh = labelled(mesh.points, mesh.cells, part=mesh.part, fixed=mesh.fixed, tissue=tissue).with_order(2)
    compiled = ElasticSystem(mesh, [SOFT, stiff, MATERIALS[1]])
    mixed = ElasticSystem(mesh, [UserMaterial(SOFT), UserMaterial(stiff), MATERIALS[1]])
    state = large_motion(compiled)
    assert mixed.energy(state) == pytest.approx(compiled.energy(state), rel=1e-12)
    expected = compiled.gradient(state)
    np.testing.assert_allclose(mixed.gradient(state), expected, atol=1e-11 * np.abs(expected).max())
    expected = compiled.tangent(state, project=project).data
    np.testing.assert_allclose(mixed.tangent(state, project=project).data, expected, atol=1e-9 * np.abs(expected).max())


def test_results_do_not_depend_on_threads():
    mesh = block((9, 8, 8), shake=0.2)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9).with_order(2)
    one, two = (ElasticSystem(mesh, [SOFT], threads=threads) for threads in (1, 2))
    state = one.advance(one.rest_state(), 0.005 * np.random.default_rng(0).normal(size=one.n_dofs))
    assert one.energy(state) == two.energy(state)
    np.testing.assert_array_equal(one.gradient(state), two.gradient(state))
    np.testing.assert_array_equal(one.tangent(state).data, two.tangent(state).data)


def test_jacobians_are_taken_where_the_cell_is_bent():
    # One cell whose midpoint of the edge 0–1 is pushed towards vertex 0: near it, lengths along the edge shrink.
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    mesh = labelled(points, np.array([[0, 1, 2, 3]])).with_order(2)
    system = ElasticSystem(mesh, [SOFT])
    moved = mesh.node_points.copy()
    moved[4 + edge_index(mesh, np.array([0, 1])), 0] -= 0.25
    state = State(moved, np.empty((0, 3, 3)), np.empty((0, 3)))
    # x = X − ¼ · 4 λ₀ λ₁, hence ∂x/∂X = 1 − (λ₀ − λ₁): zero at vertex 0, 1 − (α − β) at the nearest quadrature point
    assert system.vertex_jacobians(state) == pytest.approx(0.0, abs=1e-12)
    assert system.jacobians(state) == pytest.approx(1.0 - 1.0 / np.sqrt(5.0))
