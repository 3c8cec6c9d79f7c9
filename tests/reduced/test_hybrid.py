"""The hybrid model on equilibria that finite elements have solved, its Newton step against dense algebra, its files."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json, write_json
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.evaluation import MetricGeometry, rigid_edge_error
from mixpinn.fem import ElasticSystem, SuperLUSolver
from mixpinn.reduced.error_estimate import ErrorEstimate, Signs
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.hybrid import BUNDLE, HybridModel, features
from mixpinn.reduced.modes import coefficients, excited_modes, principal_modes
from mixpinn.reduced.prior import ElasticPrior
from reduced.pressed_block import TISSUE, pressed_table, top_nodes
from training.toy_block import block_mesh

CONFIG = HybridConfig(modes=12, coordinates=3)


@pytest.fixture(scope="module")
def mesh():
    return block_mesh()


@pytest.fixture(scope="module")
def table(mesh):
    return pressed_table(mesh, 44)


@pytest.fixture(scope="module")
def prior(mesh):
    return ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())


@pytest.fixture(scope="module")
def model(prior, table):
    return fit_hybrid(prior, [TISSUE], table.at_positions(range(26)), table.at_positions(range(26, 36)), CONFIG)


def mean_error(model, table):
    return np.mean([
        np.linalg.norm(model.predict(*table.contact(i)) - table.displacement[i], axis=1).mean()
        for i in range(len(table))
    ])


def test_it_halves_the_error_of_the_prior_at_new_positions(model, prior, table) -> None:
    test = table.at_positions(range(36, 44))
    assert mean_error(model, test) < 0.5 * mean_error(prior, test)


def test_newton_step_is_that_of_dense_algebra(mesh, model, prior, table) -> None:
    sample = table[0]
    contact = prior.hold(sample.contact_nodes)
    response = prior.respond_to_forces(contact, contact.solve(sample.contact_displacement.ravel()))
    system = ElasticSystem(mesh, [TISSUE])
    upper = system.tangent(system.rest_state(), project=False).toarray()
    stiffness = upper + np.triu(upper, 1).T
    state = system.advance(system.rest_state(), response.astype(np.float64))
    residual = system.reduce(system.gradient(state), state)
    free = np.setdiff1d(np.arange(system.n_dofs), contact.unknowns)
    full = np.zeros(system.n_dofs)
    full[free] = -np.linalg.solve(stiffness[np.ix_(free, free)], residual[free])
    expected = coefficients(model.newton.modes.dense(), prior.coordinates.weights, full[None])[0]
    found = model.newton.step(response, contact)
    assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_a_regression_gone_astray_is_cut_back_to_its_reach(model, table) -> None:
    # What is learned cannot add more to the Newton step than its reach, and nothing changes while it stays within.
    assert np.isfinite(model.reach)
    contact = table.contact(0)
    usual = model.solve(*contact)
    astray = replace(model, gain=1e3 * model.gain).solve(*contact)
    learned = np.linalg.norm(astray.correction - model.newton_length * astray.step)
    assert learned == pytest.approx(model.reach * np.linalg.norm(astray.step), rel=1e-4)
    assert_array_equal(replace(model, reach=np.inf).solve(*contact).correction, usual.correction)


def test_rigid_parts_keep_their_edges(mesh, model, table) -> None:
    deepest = int(table.depth.argmax())
    field = model.predict(*table.contact(deepest))
    assert rigid_edge_error(field, mesh.points, MetricGeometry.of(mesh).rigid_edges) < 1e-6  # in single precision


def test_contact_nodes_are_where_they_were_put_and_fixed_ones_at_rest(mesh, model, table) -> None:
    field = model.predict(*table.contact(1))
    assert_array_equal(field[table.contacts(1)], table.contact(1)[1])
    assert not field[mesh.fixed].any()
    still = table.contacts(1)
    assert_allclose(model.predict(still, np.zeros((len(still), 3))), 0.0, atol=1e-12)  # held at zero


def test_saved_and_loaded_it_predicts_the_same(tmp_path, mesh, model, table) -> None:
    model.save(tmp_path)
    again = HybridModel.load(tmp_path, mesh)
    assert_allclose(again.predict(*table.contact(2)), model.predict(*table.contact(2)), atol=1e-6)
    sample = table[2]
    signs = model.signs(model.solve(sample.contact_nodes, sample.contact_displacement))
    assert again.error is not None
    assert model.error is not None
    assert again.error.bound(signs) == pytest.approx(model.error.bound(signs), rel=1e-4)


def test_other_meshes_and_formats_are_refused(tmp_path, model) -> None:
    model.save(tmp_path)
    with pytest.raises(InputError, match="mesh"):
        HybridModel.load(tmp_path, block_mesh(shift=1.0))
    write_json(tmp_path / "hybrid.json", {**read_json(tmp_path / "hybrid.json"), "format": 99})
    with pytest.raises(InputError, match="format"):
        HybridModel.load(tmp_path, block_mesh())


@pytest.mark.parametrize(("name", "damage"), [
    ("modes", lambda array: array[:, :-1]), ("duals", lambda array: array[1:]), ("coupling", lambda array: array.T),
    ("readers", lambda array: array[:-1]), ("gain", lambda array: array[:-1]), ("gain", lambda array: array * np.nan),
    ("modes", lambda array: None),
])
def test_arrays_that_do_not_fit_are_refused_by_name(tmp_path, mesh, model, name, damage) -> None:
    model.save(tmp_path)
    file = tmp_path / "hybrid.safetensors"
    arrays = read_arrays(file)[0]
    array = damage(arrays.pop(name))
    write_arrays(file, arrays if array is None else arrays | {name: array})
    BUNDLE.seal_more(tmp_path, [file.name])
    with pytest.raises(InputError, match=r"hybrid\.safetensors.*fit it again") as caught:
        HybridModel.load(tmp_path, mesh)
    assert name in str(caught.value) or name == "readers"  # whose number the gain's rows follow


def test_same_seed_same_model(prior, table, model) -> None:
    again = fit_hybrid(prior, [TISSUE], table.at_positions(range(26)), table.at_positions(range(26, 36)), CONFIG)
    assert_array_equal(again.gain, model.gain)


def test_modes_are_orthonormal_and_reproduce_what_they_span() -> None:
    rng = np.random.default_rng(5)
    weights = rng.uniform(0.5, 2.0, 40).astype(np.float32)
    rows = rng.standard_normal((30, 4)) @ rng.standard_normal((4, 40))
    modes = principal_modes(rows, weights, 10, rng=rng)
    assert len(modes) == 4
    assert_allclose((modes * weights**2) @ modes.T, np.eye(4), atol=1e-4)
    assert_allclose(coefficients(modes, weights, rows) @ modes, rows, atol=1e-4)


def test_directions_that_training_hardly_knows_are_left_out() -> None:
    rng = np.random.default_rng(6)
    weights = np.ones(20, dtype=np.float32)
    modes = np.linalg.qr(rng.standard_normal((20, 4)))[0].T.astype(np.float32)
    fields = rng.standard_normal((50, 4)) * [1.0, 0.1, 1e-2, 1e-5] @ modes
    assert_array_equal(excited_modes(modes, weights, fields), modes[:3])


def test_few_samples_leave_the_model_no_worse_than_the_prior(prior, table) -> None:
    """Two positions, each pressed twice almost alike: what tells the twins apart must not be blown up elsewhere."""
    few = table.select([0, 0, 1, 1])
    few = replace(few, displacement=few.displacement * np.array([1.0, 1.001, 1.0, 1.001], np.float32)[:, None, None])
    model = fit_hybrid(prior, [TISSUE], few, few.select([]), HybridConfig(modes=4, coordinates=12))
    test = table.at_positions(range(36, 44))
    assert mean_error(model, test) < 1.5 * mean_error(prior, test)


def test_features_hold_all_products_once() -> None:
    found = features(np.array([[7.0, 8.0]]), np.array([[2.0, 3.0, 5.0]]))
    assert found.tolist() == [[7, 8, 2, 3, 5, 4, 6, 10, 9, 15, 25]]


def test_error_bound_covers_what_it_was_calibrated_for_and_knows_what_is_far() -> None:
    rng = np.random.default_rng(2)

    def draw(count):
        sizes = np.exp(rng.normal(size=(count, 5)))
        signs = [Signs(size, rng.normal(size=3)) for size in sizes]
        return signs, 0.01 * sizes[:, 3] ** 0.8 * np.exp(0.3 * rng.normal(size=count))

    signs, error = draw(400)
    estimate = ErrorEstimate.fit(signs, error, training_coordinates=np.array([s.coordinates for s in signs]))
    new, truth = draw(2000)
    covered = np.mean([estimate.bound(sign) >= e for sign, e in zip(new, truth, strict=True)])
    assert 0.92 < covered < 0.98
    assert np.corrcoef(np.log([estimate.expected(s) for s in new]), np.log(truth))[0, 1] > 0.85
    assert estimate.outside(Signs(new[0].size, np.full(3, 50.0)))
    assert not estimate.outside(Signs(new[0].size, np.zeros(3)))


def test_settings_that_make_no_model_are_refused() -> None:
    with pytest.raises(InputError, match="neither"):
        HybridConfig(newton=False, response=False)
    with pytest.raises(InputError, match="at least 1"):
        HybridConfig(modes=0)
