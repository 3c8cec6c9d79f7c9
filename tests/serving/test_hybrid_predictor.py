"""A predictor bundle: prediction, what to think of it, and refinement down to the finite-element solution."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.fem import SuperLUSolver
from mixpinn.records import MESH_FILE
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.serving import HybridPredictor, load_predictor
from reduced.pressed_block import TISSUE, pressed_table, top_nodes


@pytest.fixture(scope="module")
def pressed(mesh):
    return pressed_table(mesh, 30, seed=3)


@pytest.fixture(scope="module")
def bundle(mesh, pressed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundle")
    prior = ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())
    model = fit_hybrid(
        prior, [TISSUE], pressed.at_positions(range(20)), pressed.at_positions(range(20, 28)),
        HybridConfig(modes=8, coordinates=3),
    )
    mesh.save(folder / MESH_FILE)
    model.save(folder)
    return folder


@pytest.fixture(scope="module")
def predictor(bundle):
    return load_predictor(bundle, threads=1)


def test_the_folder_says_which_kind_it_is(predictor, folder):
    assert isinstance(predictor, HybridPredictor)
    assert not isinstance(load_predictor(folder), HybridPredictor)
    assert predictor.loading_seconds > 0.0


def test_the_answer_is_the_prediction_with_its_motions(predictor, pressed):
    sample = pressed[29]
    by_nodes = predictor.predict_at(sample.contact_nodes, sample.contact_displacement, reference=sample.displacement)
    assert_array_equal(by_nodes.displacement, predictor.predict(*pressed.contact(29)))


def test_refinement_ends_at_the_finite_element_solution(predictor, pressed):
    sample = pressed[28]
    start = predictor.predict_at(sample.contact_nodes, sample.contact_displacement).displacement
    refined, history = predictor.refine(sample.contact_nodes, sample.contact_displacement, 4)
    before = np.linalg.norm(start - sample.displacement, axis=1).mean()
    assert before > 1e-4
    assert np.linalg.norm(refined.displacement - sample.displacement, axis=1).mean() < 1e-2 * before
    assert history[-1] < 1e-4 * history[0]
    assert_allclose(refined.displacement[sample.contact_nodes], sample.contact_displacement, atol=1e-5)


def test_a_harder_input_is_expected_to_be_worse_and_a_far_one_is_flagged(predictor, pressed):
    sample = pressed[29]
    light, strong = (
        predictor.assess(sample.contact_nodes, factor * sample.contact_displacement) for factor in (0.2, 1.0)
    )
    assert light.expected < strong.expected <= strong.bound
    assert not strong.outside
    assert predictor.assess(sample.contact_nodes, 30.0 * sample.contact_displacement).outside


def test_outputs_refuse_what_the_whole_field_refuses(predictor):
    node, outputs = int(predictor.model.prior.nodes[0]), predictor.outputs()
    for nodes, displacements in (([node], [[0.0, np.nan, 0.0]]), ([node, node], [[0.0, -1.0, 0.0]] * 2)):
        with pytest.raises(InputError) as whole:
            predictor.predict(nodes, displacements)
        with pytest.raises(InputError) as part:
            outputs.predict(nodes, displacements)
        assert str(part.value) == str(whole.value)


def test_bad_input_is_refused(predictor):
    with pytest.raises(InputError, match="probed skin"):
        predictor.predict_at([0], [[0.0, -1.0, 0.0]])
    with pytest.raises(InputError, match="finite"):
        predictor.predict_at([int(predictor.model.prior.nodes[0])], [[0.0, np.nan, 0.0]])
    with pytest.raises(InputError, match="steps"):
        predictor.refine([int(predictor.model.prior.nodes[0])], [[0.0, -1.0, 0.0]], -1)
