"""The compliance in factors against the whole one: transposed products, exact contact nodes, stated error, files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.array_file import read_npy
from mixpinn.reduced.compliance.forms import DenseCompliance, FactoredCompliance, read_ahead
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.load_states import Footprints, draw_loads
from mixpinn.reduced.prior import ElasticPrior
from reduced.basis import response_modes, unlike
from reduced.pressed_block import TISSUE, pressed_table

SMALL = Footprints(length=(8.0, 16.0), width=(6.0, 12.0), depth=(1.0, 6.0))


def in_factors(prior, modes):
    """A prior in factors, from the modes of responses to drawn contacts; skin hardly counts in them."""
    own, whole = prior._own_unknowns(), prior.compliance.matrix
    weights = prior.coordinates.weights.copy()
    weights[own] *= 1e-3
    loads = draw_loads(prior.mesh.node_points[prior.nodes], prior.own_compliance, 240, SMALL)
    modes = response_modes(loads @ whole, weights, modes)
    right = modes.copy()
    right[:, own] = 0.0
    factors = FactoredCompliance((whole * weights**2) @ modes.T, right, prior.compliance.own(own), own)
    return replace(prior, compliance=factors, missed=0.01)


@pytest.fixture(scope="module")
def factored(prior):
    return in_factors(prior, 60)


def test_all_modes_are_the_whole_compliance(mesh, prior):
    """Modes that span every response leave no error: products, their transposes, and what is multiplied out."""
    whole, rows = prior.compliance, np.arange(prior.compliance.shape[0])
    own = prior._own_unknowns()
    weights = prior.coordinates.weights
    modes = response_modes(whole.matrix, weights, len(rows))
    left = (whole.matrix * weights**2) @ modes.T
    right = modes.copy()
    right[:, own] = 0.0
    found = FactoredCompliance(left, right, whole.own(own), own)
    rng = np.random.default_rng(0)
    size = np.abs(whole.matrix).max()
    assert_allclose(found.dense().matrix, whole.matrix, atol=2e-4 * size)
    some, force = rows[5:40], rng.normal(size=35)
    residual = rng.normal(size=whole.shape[1]).astype(np.float32)
    assert_allclose(found.respond(some, force), whole.respond(some, force), atol=2e-3 * size)
    read = whole.read(some, residual)
    assert_allclose(found.read(some, residual), read, atol=1e-3 * np.abs(read).max())
    assert_allclose(found.times(residual[None]), whole.times(residual[None]), atol=1e-3 * np.abs(read).max())


def test_the_products_are_transposes_of_each_other(factored):
    rng = np.random.default_rng(1)
    compliance = factored.compliance
    rows, force = np.arange(12), rng.normal(size=12).astype(np.float32)
    residual = rng.normal(size=compliance.shape[1]).astype(np.float32)
    there, back = compliance.respond(rows, force) @ residual, force @ compliance.read(rows, residual)
    assert there == pytest.approx(back, rel=1e-3)
    assert_allclose(compliance.dense().respond(rows, force), compliance.respond(rows, force), rtol=0.01, atol=1e-5)


def test_contact_nodes_answer_exactly_and_others_nearly(mesh, prior, factored):
    """On contacts of another draw, too."""
    loads = draw_loads(
        mesh.node_points[prior.nodes], prior.own_compliance, 20, Footprints(**{**vars(SMALL), "seed": 9}),
    )
    rows, own = np.arange(loads.shape[1]), prior._own_unknowns()
    exact = np.array([prior.compliance.respond(rows, load) for load in loads])
    found = np.array([factored.compliance.respond(rows, load) for load in loads])
    assert_allclose(found[:, own], exact[:, own], atol=1e-4 * np.abs(exact).max())
    few = in_factors(prior, 20).compliance
    fewer = np.array([few.respond(rows, load) for load in loads])
    missed, more = (np.sqrt((unlike(each, exact, prior.coordinates.weights) ** 2).mean()) for each in (found, fewer))
    assert missed < min(0.05, more)


def test_saved_factors_stay_factors(mesh, factored, tmp_path):
    factored.save(tmp_path)
    again = ElasticPrior.load(tmp_path, mesh)
    assert isinstance(again.compliance, FactoredCompliance)
    assert again.missed == factored.missed
    rows = np.arange(9)
    assert_array_equal(again.compliance.respond(rows, rows), factored.compliance.respond(rows, rows))


def test_the_hybrid_model_on_factors_is_nearly_as_good(mesh, prior, factored):
    if mesh.order == 2:
        pytest.skip("solving the samples on ten-node cells takes too long; the products are tested above")
    table = pressed_table(mesh, 44)
    train, validation, test = (table.at_positions(range(*ends)) for ends in ((0, 26), (26, 36), (36, 44)))
    config = HybridConfig(modes=12, coordinates=3)
    errors = []
    for own in (prior, factored):
        model = fit_hybrid(own, [TISSUE], train, validation, config)
        errors.append(np.mean([
            np.linalg.norm(model.predict(*test.contact(i)) - test.displacement[i], axis=1).mean()
            for i in range(len(test))
        ]))
    assert errors[1] < 1.2 * errors[0]


def test_loads_press_on_a_footprint(mesh, prior):
    loads = draw_loads(mesh.node_points[prior.nodes], prior.own_compliance, 30, SMALL).reshape(30, -1, 3)
    assert (np.abs(loads).sum(axis=(1, 2)) > 0.0).all()
    assert (loads[:, :, 1].sum(axis=1) < 0.0).all()
    again = draw_loads(mesh.node_points[prior.nodes], prior.own_compliance, 30, SMALL).reshape(30, -1, 3)
    assert_array_equal(loads, again)


def test_a_dense_compliance_is_read_row_by_row():
    rng = np.random.default_rng(2)
    matrix = rng.normal(size=(6, 11)).astype(np.float32)
    rows, residual = np.array([4, 1]), rng.normal(size=11).astype(np.float32)
    found = DenseCompliance(matrix)
    assert_allclose(found.read(rows, residual), matrix[rows] @ residual, rtol=1e-4, atol=1e-5)
    assert_allclose(found.respond(rows, [1.0, 2.0]), matrix[4] + 2.0 * matrix[1], rtol=1e-5, atol=1e-6)


def test_read_ahead_reads_what_is_mapped_and_leaves_everything_as_it_is(tmp_path: Path) -> None:
    matrix = np.random.default_rng(0).normal(size=(12, 6000)).astype(np.float32)
    for order in ("C", "F"):
        np.save(tmp_path / "matrix.npy", np.asarray(matrix, order=order))
        compliance = DenseCompliance(read_npy(tmp_path / "matrix.npy", mapped=True))
        for one in (compliance, DenseCompliance(matrix), DenseCompliance(matrix[:0])):
            read_ahead(one)
        assert_array_equal(compliance.matrix, matrix)
