"""What is added to the prior, on features whose law is known, and on few presses of a block of ten-node cells."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.fem import SuperLUSolver
from mixpinn.reduced.correction import choose_correction, learned_share, smaller
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.hybrid import features
from mixpinn.reduced.prior import ElasticPrior
from reduced.pressed_block import TISSUE, pressed_table, top_nodes
from training.toy_block import block_mesh

PENALTIES = (1e-4, 1e-2, 1.0)


def chosen(step, coordinates, target, position, **other):
    none = np.zeros((0, step.shape[1]))
    settings = {
        "responses": coordinates, "drawn": none, "newton": True, "response": True, "penalties": PENALTIES, **other,
    }
    return choose_correction(
        step.astype(np.float32), coordinates.astype(np.float32), target.astype(np.float32), position, **settings,
    )


def drawn(positions, each=5, modes=4, coordinates=3, seed=0):
    rng = np.random.default_rng(seed)
    count = positions * each
    return rng, rng.standard_normal((count, modes)), rng.standard_normal((count, coordinates)), (
        np.repeat(np.arange(positions), each)
    )


def test_what_nothing_explains_is_left_to_the_prior():
    rng, step, coordinates, position = drawn(6)
    gain, about = chosen(step, coordinates, rng.standard_normal(step.shape), position)
    assert about["correction"] == "none"
    assert not gain.any()


def test_a_multiple_of_the_newton_step_is_found_and_nothing_is_added_to_it():
    rng, step, coordinates, position = drawn(6)
    target = 0.4 * step + 0.1 * rng.standard_normal(step.shape)
    gain, about = chosen(step, coordinates, target, position)
    assert about["correction"] == "Newton step"
    assert about["newton_length"] == pytest.approx((step * target).sum() / (step**2).sum(), rel=1e-6)
    assert_allclose(gain[:4], about["newton_length"] * np.eye(4), rtol=1e-6)
    assert not gain[4:].any()


def test_a_law_of_second_order_is_learned():
    rng, step, coordinates, position = drawn(20)
    law = rng.standard_normal((13, 4))
    rows = features(step, coordinates)
    gain, about = chosen(step, coordinates, rows @ law, position)
    assert about["correction"] == "regression"
    assert_allclose(gain, law, atol=0.02)
    assert about["cross_validation"] == about["cross_validated"]["regression"]
    assert about["cross_validated"].keys() == {
        "none", "Newton step", "regression on the Newton step", "regression",
    }


def test_a_step_that_points_away_is_not_taken():
    _, step, coordinates, position = drawn(6)
    gain, about = chosen(step, coordinates, -step, position, response=False, penalties=(1e3,))
    assert about["newton_length"] == 0.0
    assert (np.diag(gain[:4]) <= 0.0).all()


def test_one_position_says_nothing_about_others():
    _, step, coordinates, position = drawn(1, each=20)
    gain, about = chosen(step, coordinates, 0.5 * step, position)
    assert about["correction"] == "none"
    assert not gain.any()


def test_what_training_hardly_excites_is_not_blown_up():
    """Every position excites a direction of its own, by which the others know it only as noise."""
    rng, step, _, position = drawn(4, each=10)
    coordinates = 1e-2 * rng.standard_normal((40, 4))
    coordinates[np.arange(40), position] += rng.uniform(0.0, 10.0, 40)
    own = np.eye(4)[position] * rng.uniform(0.0, 1.0, 40)[:, None]
    _, about = chosen(0.01 * step, coordinates, own, position)
    assert about["cross_validation"] <= about["cross_validated"]["none"]
    assert about["correction"] != "regression" or about["even"] > 0.0


def test_the_share_that_was_learned_ignores_samples_without_a_step():
    step, learned = np.ones((100, 2)), np.full((100, 2), 0.5)
    step[0] = 1e-9
    assert learned_share(step, 0.3 * step + learned, 0.3) == pytest.approx(0.5)


@pytest.fixture(scope="module")
def mesh():
    return block_mesh().with_order(2)


@pytest.fixture(scope="module")
def table(mesh):
    return pressed_table(mesh, 16)


@pytest.fixture(scope="module")
def prior(mesh):
    return ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())


def mean_error(model, table):
    return np.mean([
        np.linalg.norm(model.predict(*table.contact(i)) - table.displacement[i], axis=1).mean()
        for i in range(len(table))
    ])


@pytest.mark.parametrize(("samples", "each"), [(1, 1), (2, 1), (4, 4), (4, 2), (8, 4)])
def test_few_presses_of_ten_node_cells_leave_the_model_no_worse_than_the_prior(prior, table, samples, each):
    """Two positions with four presses each made the regression worse than the prior; a single sample stopped it."""
    few = replace(table.select(list(range(samples))), position_index=np.arange(samples) // each)
    model = fit_hybrid(prior, [TISSUE], few, few.select([]), HybridConfig())
    test = table.at_positions(range(8, 16))
    newton = np.zeros_like(model.gain)
    newton[: len(model.newton.modes)] = model.newton_length * np.eye(len(model.newton.modes))
    physics = mean_error(replace(model, gain=newton, reach=np.inf), test)
    assert mean_error(model, test) <= 1.02 * min(mean_error(prior, test), physics)


def test_errors_are_smaller_for_sure_by_more_than_their_standard_error():
    """Two samples a position; the positions gain 1, 2 and 3: 2 on average, with a standard error of 1/√3."""
    part, than = np.array([0, 0, 1, 1, 2, 2]), np.full(6, 5.0)
    gained = np.array([0.0, 2.0, 1.0, 3.0, 2.0, 4.0])
    assert smaller(than - gained, than, part, margin=True)
    assert not smaller(than - gained + 1.5, than, part, margin=True)  # 0.5 on average
    assert smaller(than - gained + 1.5, than, part, margin=False)
