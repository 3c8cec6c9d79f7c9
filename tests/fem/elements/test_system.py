from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from skfem.helpers import ddot, eye, sym_grad, trace

from fem.block_mesh import block, labelled, two_bones
from mixpinn.base.errors import InputError
from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.fem.material.hyperelastic import LinearElastic, StableNeoHookean, StableNeoHookeanLog
from mixpinn.fem.solve.linear import SuperLUSolver, symmetric_product
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.records import TissueMesh

SOFT = StableNeoHookean(mu=1.0, lam=4.0)
MATERIALS = [SOFT, StableNeoHookeanLog(mu=1.0, lam=4.0), LinearElastic(mu=1.0, lam=4.0)]
angle = st.floats(-1.5, 1.5, allow_nan=False)


def full(upper: sp.csr_matrix) -> np.ndarray:
    dense = upper.toarray()
    return dense + np.triu(dense, 1).T


def equilibrium(system: ElasticSystem, state: State, held: np.ndarray, load: np.ndarray | None = None,
                tolerance: float = 1e-12, shift: np.ndarray | None = None) -> tuple[State, list[float]]:
    """Newton with the exact tangent; held unknowns keep their value, `shift` is imposed on them at once."""
    solver, history = SuperLUSolver(), []
    load = np.zeros_like(state.points) if load is None else load
    shift = np.zeros(system.n_dofs) if shift is None else shift
    for _ in range(30):
        nodal = system.gradient(state) - load
        residual = system.reduce(nodal, state)
        if not shift.any():
            history.append(float(np.linalg.norm(residual[~held])))
            if history[-1] <= tolerance:
                return state, history
        matrix = system.tangent(state, nodal_gradient=nodal, project=False)
        rhs = -residual - symmetric_product(matrix, shift)
        rhs[held] = shift[held]
        solver.factorize(system.hold(matrix, held))
        state, shift = system.advance(state, solver.solve(rhs)), np.zeros(system.n_dofs)
    raise AssertionError(f"no convergence: {history}")


def boundary(mesh: TissueMesh) -> np.ndarray:
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    return ((mesh.points < low + 1e-9) | (mesh.points > high - 1e-9)).any(axis=1)


def large_motion(system: ElasticSystem, seed: int = 0) -> State:
    """Bones turned by up to two radians, soft nodes scattered."""
    rng = np.random.default_rng(seed)
    increment = rng.normal(size=system.n_dofs)
    increment[-12:] = [3.0, -2.0, 4.0, 1.3, -0.8, 1.2, -5.0, 1.0, 2.0, -0.4, 1.6, 0.7]
    return system.advance(system.rest_state(), increment)


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_energy_gradient_and_tangent_agree(material):
    system, h = ElasticSystem(two_bones(), [material]), 1e-4
    state, rng = large_motion(system), np.random.default_rng(1)
    nodal = system.gradient(state)
    residual, tangent = system.reduce(nodal, state), full(system.tangent(state, project=False))
    moment = system.part_wrench(nodal, state)[:, 3:]
    for _ in range(5):
        direction = rng.normal(size=system.n_dofs)
        direction[-12:].reshape(2, 6)[:, 3:] *= 0.1
        ends = [system.advance(state, sign * h * direction) for sign in (1.0, -1.0)]
        slope = (system.energy(ends[0]) - system.energy(ends[1])) / (2.0 * h)
        assert slope == pytest.approx(residual @ direction, rel=1e-6)
        change = np.subtract(*[system.reduce(system.gradient(end), end) for end in ends]) / (2.0 * h)
        # The derivative from state to state has the skew part −½ [m] in the rotations, the Hessian has not.
        change[-12:].reshape(2, 6)[:, 3:] += 0.5 * np.cross(moment, direction[-12:].reshape(2, 6)[:, 3:])
        np.testing.assert_allclose(change, tangent @ direction, atol=1e-6 * np.abs(change).max())


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


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_affine_patch(material):
    mesh = block((3, 3, 3), shake=0.25)
    system = ElasticSystem(mesh, [material])
    affine = np.array([[0.15, 0.1, -0.05], [0.02, -0.1, 0.08], [0.12, 0.0, 0.05]])
    exact = mesh.points @ affine.T
    held = np.repeat(boundary(mesh), 3)
    shift = np.where(held, exact.ravel(), 0.0)
    state, _ = equilibrium(system, system.rest_state(), held, shift=shift)
    assert np.abs(state.points - mesh.points - exact).max() <= 1e-10
    stress = material.gradient((np.eye(3) + affine)[None])[0]
    # Energy of the homogeneous state, and the traction P n on the face x = 1.
    assert system.energy(state) == pytest.approx(material.energy((np.eye(3) + affine)[None])[0], rel=1e-10)
    face = mesh.points[:, 0] > 1.0 - 1e-9
    ring = face & ((mesh.points[:, 1:] > 1e-9) & (mesh.points[:, 1:] < 1.0 - 1e-9)).all(axis=1)
    traction = np.tile(stress[:, 0] / 9.0, (ring.sum(), 1))  # a node inside the face carries a third by a third of it
    np.testing.assert_allclose(system.gradient(state)[ring], traction, atol=1e-10)


@pytest.mark.parametrize("material", MATERIALS[:2], ids=repr)
@pytest.mark.parametrize("stretch", [0.5, 0.75, 1.25, 2.0])
def test_uniaxial_stretch_against_the_closed_form(material, stretch):
    mesh = block((2, 2, 2), shake=0.2)
    system = ElasticSystem(mesh, [material])
    x, y, z = mesh.points.T
    held = np.zeros((mesh.n_points, 3), dtype=bool)
    held[(x < 1e-9) | (x > 1.0 - 1e-9), 0] = True  # sliding on the planes x = 0, y = 0, z = 0
    held[y < 1e-9, 1] = held[z < 1e-9, 2] = True
    state = system.rest_state()
    steps = 5
    for _ in range(steps):
        shift = np.zeros((mesh.n_points, 3))
        shift[x > 1.0 - 1e-9, 0] = (stretch - 1.0) / steps
        state, _ = equilibrium(system, state, held.ravel(), shift=shift.ravel(), tolerance=1e-10)

    # The lateral stretch l makes the lateral stress vanish. Without the logarithm: μ l + (λ + μ)(s l² − α) s l = 0;
    # with it: m (1 − 1/(s² + 2l² + 1)) l + bulk (s l² − α) s l = 0.
    mu, lam = material.mu, material.lam

    def moduli(lateral):
        if isinstance(material, StableNeoHookean):
            return mu, lam + mu, 1.0 + mu / (lam + mu)
        m, bulk = 4.0 / 3.0 * mu, lam + 5.0 / 6.0 * mu
        return m * (1.0 - 1.0 / (stretch**2 + 2.0 * lateral**2 + 1.0)), bulk, 1.0 + 0.75 * m / bulk

    def lateral_stress(lateral):
        shear, bulk, alpha = moduli(lateral)
        return shear + bulk * (stretch * lateral**2 - alpha) * stretch

    lateral = brentq(lateral_stress, 0.1, 3.0, xtol=1e-14)
    shear, bulk, alpha = moduli(lateral)
    force = shear * stretch + bulk * (stretch * lateral**2 - alpha) * lateral**2
    found = system.gradient(state)[x > 1.0 - 1e-9, 0].sum()
    assert found == pytest.approx(force, rel=1e-8)
    np.testing.assert_allclose(state.points[:, 1], lateral * y, atol=1e-8)


@pytest.mark.parametrize("shear", [0.25, 1.0])
def test_simple_shear_against_the_closed_form(shear):
    mesh = block((3, 3, 3), shake=0.2)
    system = ElasticSystem(mesh, [SOFT])
    held = np.repeat(boundary(mesh), 3)
    shift = np.zeros((mesh.n_points, 3))
    shift[:, 0] = shear * mesh.points[:, 1]
    state, _ = equilibrium(
        system, system.rest_state(), held, shift=np.where(held, shift.ravel(), 0.0), tolerance=1e-11,
    )
    # J = 1, so that W = μ/2 γ² and the shear force per area is ∂W/∂γ = μ γ.
    assert system.energy(state) == pytest.approx(0.5 * SOFT.mu * shear**2, rel=1e-10)
    top = mesh.points[:, 1] > 1.0 - 1e-9
    inner = top & (np.abs(mesh.points[:, [0, 2]] - 0.5) < 0.4).all(axis=1)
    np.testing.assert_allclose(system.gradient(state)[inner, 0], SOFT.mu * shear / 9.0, rtol=1e-9)


def test_linear_elasticity_against_scikit_fem():
    mesh = block((4, 3, 3), size=(2.0, 1.0, 1.0), shake=0.25)
    material = LinearElastic.from_young(3.0, 0.4)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9)
    system = ElasticSystem(mesh, [material])
    load = np.random.default_rng(0).normal(size=(mesh.n_points, 3))
    state, _ = equilibrium(
        system, system.rest_state(), np.zeros(system.n_dofs, dtype=bool), load=load, tolerance=1e-9,
    )
    oracle = skfem.MeshTet(mesh.points.T.copy(), mesh.cells.T.astype(np.int64).copy())
    basis = skfem.Basis(oracle, skfem.ElementVector(skfem.ElementTetP1()), intorder=1)

    @skfem.BilinearForm
    def stiffness(u, v, _):
        strain = sym_grad(u)
        return ddot(2.0 * material.mu * strain + material.lam * eye(trace(strain), 3), sym_grad(v))

    matrix, rhs = stiffness.assemble(basis), np.zeros(basis.N)
    rhs[basis.nodal_dofs] = load.T
    solution = skfem.solve(*skfem.condense(matrix, rhs, D=basis.nodal_dofs[:, mesh.fixed].ravel()))
    expected = solution[basis.nodal_dofs].T
    assert np.abs(state.points - mesh.points - expected).max() <= 1e-8 * np.abs(expected).max()


def test_displacement_converges_with_order_two():
    # Manufactured u = a sin(πx) sin(πy) sin(πz), zero on the cube's faces; −div σ(u) is the body force.
    material, a, errors = LinearElastic(mu=1.0, lam=1.5), np.array([1.0, -0.5, 0.7]), []
    sizes = np.array([4, 8, 12])
    for n in sizes:
        mesh = block((int(n),) * 3)
        mesh = labelled(mesh.points, mesh.cells, fixed=boundary(mesh))
        system = ElasticSystem(mesh, [material])
        # Quadrature of degree 2 with the points at barycentric (α, β, β, β).
        alpha, beta = 0.5854101966249685, 0.1381966011250105
        weights = np.full((4, 4), beta) + (alpha - beta) * np.eye(4)
        corners = mesh.points[mesh.cells]
        places = np.einsum("qa,mai->mqi", weights, corners)
        force = np.einsum("mqi,qa,m->mai", body_force(places, a, material), weights, mesh.cell_volumes / 4.0)
        load = np.zeros_like(mesh.points)
        np.add.at(load, mesh.cells, force)
        state, _ = equilibrium(
            system, system.rest_state(), np.zeros(system.n_dofs, dtype=bool), load=load, tolerance=1e-10,
        )
        moved = state.points - mesh.points
        exact = a * np.sin(np.pi * places).prod(axis=-1)[..., None]
        error = np.einsum("qa,mai->mqi", weights, moved[mesh.cells]) - exact
        errors.append(np.sqrt(np.einsum("mqi,mqi,m->", error, error, mesh.cell_volumes / 4.0)))
    # The coarsest mesh is not yet asymptotic: the order is taken between the two finest.
    order = np.log(errors[-2] / errors[-1]) / np.log(sizes[-1] / sizes[-2])
    assert 1.8 <= order <= 2.2


def body_force(x, a, material):
    """−μ Δu − (λ + μ) ∇ div u for u = a S, S = Π sin(π x_i)."""
    s, c = np.sin(np.pi * x), np.cos(np.pi * x)
    product = s.prod(axis=-1)
    second = np.empty((*x.shape, 3))  # ∂_i ∂_j S
    for i in range(3):
        for j in range(3):
            k = 3 - i - j
            second[..., i, j] = -(np.pi**2) * product if i == j else np.pi**2 * c[..., i] * c[..., j] * s[..., k]
    return 3.0 * np.pi**2 * material.mu * product[..., None] * a - (material.lam + material.mu) * (second @ a)


def test_newton_converges_quadratically_with_rigid_parts():
    mesh = two_bones()
    system = ElasticSystem(mesh, [SOFT])
    load = np.zeros_like(mesh.points)
    top = mesh.points[:, 2] > 30.0 - 1e-9
    load[top] = [4.0, -3.0, -10.0]
    load[mesh.part == 2] = [0.0, 5.0, -2.0]
    held = np.zeros(system.n_dofs, dtype=bool)
    state, history = equilibrium(system, system.rest_state(), held, load=load, tolerance=1e-10)
    assert np.abs(state.translation).max() > 0.5
    assert np.abs(state.rotation - np.eye(3)).max() > 0.02
    # e_{k+1} ≤ C e_k²: in the last steps above rounding the exponent log(e_{k+1}/e_k)/log(e_k/e_{k−1}) is about 2.
    above = [value for value in history if value > 1e-11 * history[0]]
    orders = np.diff(np.log(above))[1:] / np.diff(np.log(above))[:-1]
    assert orders[-1] >= 1.9
    # Equilibrium of each body, and of the whole: reactions of the fixed nodes balance the load.
    net = system.gradient(state) - load
    assert np.abs(system.part_wrench(net, state)).max() <= 1e-9
    np.testing.assert_allclose(net[mesh.fixed].sum(axis=0), -load.sum(axis=0), atol=1e-8)


@dataclass(frozen=True)
class UserMaterial:
    """The stable Neo-Hookean once more, in plain NumPy, under another type."""

    inner: StableNeoHookean

    def energy(self, deformation):
        return self.inner.energy(deformation)

    def gradient(self, deformation):
        return self.inner.gradient(deformation)

    def hessian(self, deformation):
        return self.inner.hessian(deformation)


@pytest.mark.parametrize("project", [True, False])
def test_materials_of_the_user_and_several_tissues(project):
    mesh, stiff = two_bones(), StableNeoHookean(mu=3.0, lam=20.0)
    tissue = np.arange(len(mesh.cells)) % 3
    mesh = labelled(mesh.points, mesh.cells, part=mesh.part, fixed=mesh.fixed, tissue=tissue)
    compiled = ElasticSystem(mesh, [SOFT, stiff, MATERIALS[1]])
    mixed = ElasticSystem(mesh, [UserMaterial(SOFT), UserMaterial(stiff), MATERIALS[1]])
    state = large_motion(compiled)
    assert mixed.energy(state) == pytest.approx(compiled.energy(state), rel=1e-12)
    expected = compiled.gradient(state)
    np.testing.assert_allclose(mixed.gradient(state), expected, atol=1e-11 * np.abs(expected).max())
    expected = compiled.tangent(state, project=project).data
    np.testing.assert_allclose(mixed.tangent(state, project=project).data, expected, atol=1e-9 * np.abs(expected).max())


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


def test_results_do_not_depend_on_threads():
    mesh = block((9, 8, 8), shake=0.2)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9)
    one, two = (ElasticSystem(mesh, [SOFT], threads=threads) for threads in (1, 2))
    state = one.advance(one.rest_state(), 0.01 * np.random.default_rng(0).normal(size=one.n_dofs))
    assert one.energy(state) == two.energy(state)
    np.testing.assert_array_equal(one.gradient(state), two.gradient(state))
    np.testing.assert_array_equal(one.tangent(state).data, two.tangent(state).data)


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
