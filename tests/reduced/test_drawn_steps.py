"""Newton steps of drawn contacts against dense algebra, on a body of two tissues with a joint and foundations."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.fem import ElasticSystem, StableNeoHookean, SuperLUSolver
from mixpinn.physics.restraints import Restraints
from mixpinn.reduced.drawn_steps import drawn_steps
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.load_states import Footprints, draw_loads
from mixpinn.reduced.modes import coefficients
from mixpinn.reduced.prior import ElasticPrior
from reduced.pressed_block import TISSUE, pressed_table, top_nodes
from reduced.test_restraints import JOINT, PAD, SLIDE, free
from training.toy_block import block_mesh

MATERIALS = (TISSUE, StableNeoHookean.from_young(62.2e-3, 0.45))
FOOTPRINTS = Footprints(length=(6.0, 10.0), width=(5.0, 8.0), depth=(1.0, 4.0))


@pytest.fixture(scope="module")
def body():
    plain = free(block_mesh())
    deep = plain.points[plain.cells].mean(axis=1)[:, 1] < np.median(plain.points[:, 1])
    mesh = replace(plain, tissue=deep.astype(np.uint8), tissue_names=("body", "muscle"))
    tied = Restraints((JOINT,), (PAD, SLIDE))
    system = ElasticSystem(mesh, MATERIALS, joints=tied.joints, foundations=tied.foundations)
    prior = ElasticPrior.build(
        mesh, MATERIALS, nodes=top_nodes(mesh), linear=SuperLUSolver(), restraints=tied,
    )
    return mesh, tied, system, prior


def newton_step(system, response, contact):
    """With the stiffness at rest and the contact nodes held, by dense algebra in double precision."""
    upper = system.tangent(system.rest_state(), project=False).toarray()
    stiffness = upper + np.triu(upper, 1).T
    state = system.advance(system.rest_state(), response.astype(np.float64))
    residual = system.residual(system.gradient(state), state)
    moving = np.setdiff1d(np.arange(system.n_dofs), contact.unknowns)
    step = np.zeros(system.n_dofs)
    step[moving] = -np.linalg.solve(stiffness[np.ix_(moving, moving)], residual[moving])
    return step


def test_each_is_the_newton_step_from_the_answer_to_its_contact(body) -> None:
    mesh, tied, system, prior = body
    linear = SuperLUSolver()
    linear.factorize(system.tangent(system.rest_state()))
    found = drawn_steps(prior, Equilibrium.of_materials(mesh, MATERIALS, tied), linear, 4, FOOTPRINTS)
    loads = draw_loads(mesh.node_points[prior.nodes], prior.own_compliance, 4, FOOTPRINTS)
    for step, load in zip(found, loads, strict=True):
        contact = prior.hold(prior.nodes[load.reshape(-1, 3).any(axis=1)])
        expected = newton_step(system, prior.respond_to_forces(contact, load[contact.rows]), contact)
        assert_allclose(step, expected, atol=1e-3 * np.abs(expected).max())
        assert np.abs(step[contact.unknowns]).max() < 1e-5


def test_none_are_none(body) -> None:
    mesh, tied, system, prior = body
    linear = SuperLUSolver()
    linear.factorize(system.tangent(system.rest_state()))
    assert drawn_steps(prior, Equilibrium.of_materials(mesh, MATERIALS, tied), linear, 0).shape == (0, system.n_dofs)


def test_the_modal_step_is_exact_with_tissues_joint_and_foundations(body) -> None:
    mesh, tied, system, prior = body
    table = pressed_table(mesh, 8, seed=4, restraints=tied, materials=MATERIALS)
    config = HybridConfig(modes=10, coordinates=3, drawn_contacts=20)
    model = fit_hybrid(prior, MATERIALS, table.at_positions(range(6)), table.at_positions(range(6, 8)), config)
    contact = prior.hold(table[7].contact_nodes)
    response = prior.respond_to_forces(contact, contact.solve(table[7].contact_displacement.ravel()))
    expected = coefficients(
        model.newton.modes.dense(), prior.coordinates.weights, newton_step(system, response, contact)[None],
    )[0]
    assert_allclose(model.newton.step(response, contact), expected, atol=1e-3 * np.abs(expected).max())
