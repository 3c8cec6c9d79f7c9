"""What tests of the elastic system share: materials, states far from rest, dense tangents, equilibrium by Newton."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp

from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.fem.material.hyperelastic import LinearElastic, StableNeoHookean, StableNeoHookeanLog
from mixpinn.records import TissueMesh
from validation import newton

SOFT = StableNeoHookean(mu=1.0, lam=4.0)
MATERIALS = [SOFT, StableNeoHookeanLog(mu=1.0, lam=4.0), LinearElastic(mu=1.0, lam=4.0)]


def full(upper: sp.csr_matrix) -> np.ndarray:
    dense = upper.toarray()
    return dense + np.triu(dense, 1).T


def equilibrium(system: ElasticSystem, state: State, held: np.ndarray | None = None, load: np.ndarray | None = None,
                tolerance: float = 1e-12, shift: np.ndarray | None = None) -> tuple[State, list[float]]:
    """Newton with the exact tangent; held unknowns keep their value, `shift` is imposed on them at once."""
    found = newton.equilibrium(system, state, held=held, load=load, tolerance=tolerance, shift=shift)
    assert found.converged, f"no convergence: {found.history}"
    return found.state, found.history


def outer(mesh: TissueMesh) -> np.ndarray:
    """Nodes on the faces of the bounding box, midpoints included."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    return ((mesh.node_points < low + 1e-9) | (mesh.node_points > high - 1e-9)).any(axis=1)


def large_motion(system: ElasticSystem, *, scatter: float = 1.0) -> State:
    """Two bones turned by up to two radians, soft nodes scattered."""
    increment = scatter * np.random.default_rng(0).normal(size=system.n_dofs)
    increment[-12:] = [3.0, -2.0, 4.0, 1.3, -0.8, 1.2, -5.0, 1.0, 2.0, -0.4, 1.6, 0.7]
    return system.advance(system.rest_state(), increment)


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


def check_derivatives(system: ElasticSystem, state: State, *, directions: int, h: float = 1e-4) -> None:
    """Residual and tangent of a system with two bones against differences of the energy along random directions."""
    rng = np.random.default_rng(1)
    nodal = system.gradient(state)
    residual, tangent = system.reduce(nodal, state), full(system.tangent(state, project=False))
    moment = system.part_wrench(nodal, state)[:, 3:]
    for _ in range(directions):
        direction = rng.normal(size=system.n_dofs)
        direction[-12:].reshape(2, 6)[:, 3:] *= 0.1
        ends = [system.advance(state, sign * h * direction) for sign in (1.0, -1.0)]
        slope = (system.energy(ends[0]) - system.energy(ends[1])) / (2.0 * h)
        assert slope == pytest.approx(residual @ direction, rel=1e-6)
        change = np.subtract(*[system.reduce(system.gradient(end), end) for end in ends]) / (2.0 * h)
        # The derivative from state to state has the skew part −½ [m] in the rotations, the Hessian has not.
        change[-12:].reshape(2, 6)[:, 3:] += 0.5 * np.cross(moment, direction[-12:].reshape(2, 6)[:, 3:])
        np.testing.assert_allclose(change, tangent @ direction, atol=1e-6 * np.abs(change).max())


def check_user_materials(mesh: TissueMesh, *, project: bool, scatter: float = 1.0) -> None:
    """Materials that are not compiled, mixed with one that is, against compiled ones on a mesh of three tissues."""
    stiff = StableNeoHookean(mu=3.0, lam=20.0)
    compiled = ElasticSystem(mesh, [SOFT, stiff, MATERIALS[1]])
    mixed = ElasticSystem(mesh, [UserMaterial(SOFT), UserMaterial(stiff), MATERIALS[1]])
    state = large_motion(compiled, scatter=scatter)
    assert mixed.energy(state) == pytest.approx(compiled.energy(state), rel=1e-12)
    expected = compiled.gradient(state)
    np.testing.assert_allclose(mixed.gradient(state), expected, atol=1e-11 * np.abs(expected).max())
    expected = compiled.tangent(state, project=project).data
    np.testing.assert_allclose(mixed.tangent(state, project=project).data, expected, atol=1e-9 * np.abs(expected).max())


def check_threads(mesh: TissueMesh, *, scatter: float) -> None:
    """One thread and two give the same energy, forces and tangent to the last bit."""
    one, two = (ElasticSystem(mesh, [SOFT], threads=threads) for threads in (1, 2))
    state = one.advance(one.rest_state(), scatter * np.random.default_rng(0).normal(size=one.n_dofs))
    assert one.energy(state) == two.energy(state)
    np.testing.assert_array_equal(one.gradient(state), two.gradient(state))
    np.testing.assert_array_equal(one.tangent(state).data, two.tangent(state).data)
