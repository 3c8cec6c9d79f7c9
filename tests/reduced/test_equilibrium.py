"""The residual in single precision against the solver's, and the coordinates that it is gathered on."""

import numpy as np
import pytest

from fem.block_mesh import carved, two_bones
from mixpinn.base.errors import InputError
from mixpinn.fem import PAPER_TISSUE, ElasticSystem, LinearElastic
from mixpinn.reduced.coordinates import ReducedCoordinates
from mixpinn.reduced.equilibrium import Equilibrium
from training.toy_block import block_mesh


@pytest.fixture(scope="module", params=[1, 2])
def mesh(request):
    """Linear and quadratic cells around two cavities, whose walls carry midpoints, and around two plates."""
    return carved(two_bones()).with_order(2) if request.param == 2 else block_mesh()


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def random_state(mesh, rng, *, size):
    coordinates = ReducedCoordinates(mesh)
    unknowns = size * rng.standard_normal(coordinates.size)
    unknowns[coordinates.n_soft:] *= 0.1
    return coordinates, unknowns


def test_residual_is_that_of_the_solver(mesh, rng):
    coordinates, unknowns = random_state(mesh, rng, size=0.3)
    system = ElasticSystem(mesh, [PAPER_TISSUE])
    state = system.advance(system.rest_state(), unknowns)
    expected = system.reduce(system.gradient(state), state)
    field = coordinates.expand(unknowns)
    np.testing.assert_allclose(field, state.points - mesh.node_points, atol=1e-6)
    found = Equilibrium.of_materials(mesh, [PAPER_TISSUE]).residual(unknowns, coordinates)
    np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())


def test_rigid_motion_carries_no_force(mesh, rng):
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    field = mesh.node_points @ (turn - np.eye(3)).T + [1.0, 2.0, 3.0]
    forces = Equilibrium.of_materials(mesh, [PAPER_TISSUE]).nodal_forces(field)
    edge = np.linalg.norm(np.ptp(mesh.points, axis=0))
    assert np.abs(forces).max() < 1e-4 * PAPER_TISSUE.lam * edge**2


def test_fields_become_unknowns_and_back(mesh, rng):
    coordinates, unknowns = random_state(mesh, rng, size=0.5)
    np.testing.assert_allclose(coordinates.project(coordinates.expand(unknowns)), unknowns, atol=2e-6)


def test_weights_measure_the_displacement_of_all_nodes(mesh, rng):
    coordinates, unknowns = random_state(mesh, rng, size=1e-4)  # small rotations, where the measure is exact
    coordinates_only = unknowns.copy()
    coordinates_only[coordinates.n_soft:] = 0.0
    field = coordinates.expand(coordinates_only).astype(float)
    np.testing.assert_allclose(((coordinates.weights * coordinates_only) ** 2).sum(), (field**2).sum(), rtol=1e-5)
    one = np.zeros_like(unknowns)
    one[coordinates.n_soft + 1] = 1e-3
    assert ((coordinates.weights * one) ** 2).sum() == pytest.approx((coordinates.expand(one) ** 2).sum(), rel=1e-5)


def test_other_materials_are_refused(mesh):
    with pytest.raises(InputError, match="stable"):
        Equilibrium.of_materials(mesh, [LinearElastic(mu=1.0, lam=1.0)])
