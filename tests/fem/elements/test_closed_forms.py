"""Linear tetrahedra against closed forms, another code, and the orders of convergence that theory asks for."""

import numpy as np
import pytest
from scipy.optimize import brentq

from fem.block_mesh import block, two_bones
from fem.elements.system_checks import MATERIALS, SOFT, equilibrium, outer
from mixpinn.fem.elements.system import ElasticSystem
from mixpinn.fem.material.hyperelastic import StableNeoHookean
from validation.linear_elasticity import manufactured_error, order_of_convergence
from validation.scikit_oracle import oracle_difference


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_affine_patch(material):
    mesh = block((3, 3, 3), shake=0.25)
    system = ElasticSystem(mesh, [material])
    affine = np.array([[0.15, 0.1, -0.05], [0.02, -0.1, 0.08], [0.12, 0.0, 0.05]])
    exact = mesh.points @ affine.T
    held = np.repeat(outer(mesh), 3)
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
    held = np.repeat(outer(mesh), 3)
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
    assert oracle_difference((4, 3, 3), order=1, mirrored=False) <= 1e-8


def test_displacement_converges_with_order_two():
    sizes = (4, 8, 12)
    assert 1.8 <= order_of_convergence(sizes, [manufactured_error(n, mirrored=False) for n in sizes]) <= 2.2


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
