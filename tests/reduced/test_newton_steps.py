"""Newton steps from the prior towards the finite-element solution, with the rest-state stiffness and the true one."""

import numpy as np
import pytest

from mixpinn.fem import SuperLUSolver
from mixpinn.reduced.newton_steps import NewtonSteps
from mixpinn.reduced.prior import ElasticPrior
from reduced.pressed_block import TISSUE, pressed_table, top_nodes
from training.toy_block import block_mesh


@pytest.fixture(scope="module")
def mesh():
    return block_mesh()


@pytest.fixture(scope="module")
def prior(mesh):
    return ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())


def test_every_step_comes_closer(mesh, prior):
    table = pressed_table(mesh, 3, seed=8)
    models = [prior, *(NewtonSteps(prior, [TISSUE], steps=k) for k in (1, 2, 6))]
    errors = np.array([
        [np.linalg.norm(model.predict(*table.contact(i)) - table.displacement[i], axis=1).mean() for i in range(3)]
        for model in models
    ])
    assert (np.diff(errors, axis=0) < 0.0).all()
    assert (errors[-1] < 0.05 * errors[0]).all()


def test_names_count_the_steps_and_nothing_moves_nothing(mesh, prior):
    assert NewtonSteps(prior, [TISSUE]).name == "Prior + 1 Newton step"
    assert NewtonSteps(prior, [TISSUE], steps=3).name == "Prior + 3 Newton steps"
    assert not NewtonSteps(prior, [TISSUE]).predict(prior.nodes[:2], np.zeros((2, 3))).any()


def test_the_true_stiffness_converges_quadratically(mesh, prior):
    sample = pressed_table(mesh, 1, seed=9)[0]
    contact = prior.hold(sample.contact_nodes)
    start = prior.respond_to_forces(contact, contact.solve(sample.contact_displacement.ravel()))
    _, history = NewtonSteps(prior, [TISSUE]).refine(start, contact, 4)
    assert history[1] < history[0] ** 2
    assert history[2] < history[1] ** 2
    assert history[-1] < 1e-11
