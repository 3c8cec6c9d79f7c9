"""The compliance in clusters against the whole one: stated error, products, files, what damaged files say."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.reduced.compliance import cluster_files
from mixpinn.reduced.compliance.cluster_files import compliance_of
from mixpinn.reduced.compliance.clusters import ClusteredCompliance, rows_of
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.prior import PRIOR, ElasticPrior

OWN, TWISTS = 720, 6


@pytest.fixture(scope="module")
def kelvin():
    """A body whose points answer as those of infinite space do: (δ_ij + e_i e_j) / r; twists are random numbers."""
    rng = np.random.default_rng(11)
    places = np.column_stack([rng.uniform(0.0, [600.0, 60.0], (240, 2)), np.zeros(240)])
    inside = rng.uniform([0.0, 0.0, 4.0], [600.0, 60.0, 60.0], (800, 3))
    way = np.concatenate([places, inside])[None] - places[:, None]
    far = np.maximum(np.linalg.norm(way, axis=2), 4.0)[..., None, None]
    answers = np.eye(3) / far + way[..., :, None] * way[..., None, :] / far**3
    matrix = answers.transpose(0, 2, 1, 3).reshape(OWN, -1)
    matrix = np.concatenate([matrix, rng.normal(size=(OWN, TWISTS))], axis=1).astype(np.float32)
    return matrix, places, inside


@pytest.fixture(scope="module", params=[32, 64])
def clustered(kelvin, request):
    matrix, places, inside = kelvin
    unknowns = np.concatenate([np.arange(OWN), np.arange(matrix.shape[1] - TWISTS, matrix.shape[1])])
    return ClusteredCompliance.of(matrix, unknowns, places, inside, most=request.param)


def test_each_row_is_in_one_cluster_and_clusters_are_small(clustered) -> None:
    rows = np.concatenate([cluster.rows for cluster in clustered.clusters])
    assert_array_equal(np.sort(rows), np.arange(OWN))
    assert max(len(cluster.rows) for cluster in clustered.clusters) <= 3 * 64
    assert all(len(cluster.far) for cluster in clustered.clusters)
    kept = sum(cluster.near.numbers.size + cluster.far.numbers.size for cluster in clustered.clusters)
    assert kept < 0.7 * OWN * len(clustered.inside)


def test_answers_keep_the_stated_error(kelvin, clustered) -> None:
    """Near nodes are rounded, half a scale a force; of far ones the root mean square is stated, rounding added."""
    whole, found = kelvin[0], clustered.dense()
    assert_array_equal(found[:, :OWN], whole[:, :OWN])
    assert_array_equal(found[:, -TWISTS:], whole[:, -TWISTS:])
    for cluster in clustered.clusters:
        truth, kept = (matrix[np.ix_(cluster.rows, clustered.inside)] for matrix in (whole, found))
        largest = np.abs(truth).max(axis=1, keepdims=True)
        error = np.abs(kept - truth)
        assert (error[:, cluster.close] <= largest * (1.0 / 65_534.0 + 2e-7)).all()
        far = np.setdiff1d(np.arange(truth.shape[1]), cluster.close)
        if len(far):
            rounding = len(cluster.far) ** 0.5 / 65_534.0
            assert np.sqrt((error[:, far] ** 2).mean()) <= largest.mean() * (2e-5 + rounding)


def test_products_are_those_of_the_matrix(clustered) -> None:
    rng = np.random.default_rng(3)
    matrix = clustered.dense().astype(np.float64)
    size = np.abs(matrix).max()
    for count in (1, 4, 7, 30):
        rows, force = rng.permutation(len(matrix))[:count], rng.normal(size=count)
        fields = rng.normal(size=(2, matrix.shape[1])).astype(np.float32)
        assert_allclose(clustered.respond(rows, force), force @ matrix[rows], atol=1e-5 * size)
        assert_allclose(clustered.read(rows, fields[0]), matrix[rows] @ fields[0], atol=1e-4 * size)
        assert_allclose(clustered.times(fields), fields @ matrix.T, atol=1e-4 * size)


def test_a_response_and_its_transpose_are_one_matrix(clustered) -> None:
    """Forces f on contact nodes and r on all: r · (Cᵀ f) = f · (C r)."""
    rng = np.random.default_rng(5)
    rows, force = rng.permutation(clustered.shape[0])[:20], rng.normal(size=20).astype(np.float32)
    residual = rng.normal(size=clustered.shape[1]).astype(np.float32)
    one, other = clustered.respond(rows, force) @ residual, force @ clustered.read(rows, residual)
    size = np.linalg.norm(force @ clustered.dense()[rows]) * np.linalg.norm(residual)
    assert one == pytest.approx(other, abs=1e-5 * float(size))


def test_what_is_written_is_read_again_and_in_factors(mesh, prior, tmp_path) -> None:
    prior.save(tmp_path / "packed", packed=True)
    packed = ElasticPrior.load(tmp_path / "packed", mesh)
    assert isinstance(packed.compliance, ClusteredCompliance)
    assert_array_equal(packed.own_compliance, prior.own_compliance)
    packed.save(tmp_path / "again")
    again = ElasticPrior.load(tmp_path / "again", mesh).compliance
    assert_array_equal(again.dense(), packed.compliance.dense())
    packed.save(tmp_path / "factors", tolerance=0.05)
    matrix, found = packed.compliance.dense(), ElasticPrior.load(tmp_path / "factors", mesh).compliance.matrix
    assert np.linalg.norm(found - matrix) <= 0.05 * np.linalg.norm(matrix)


@pytest.mark.parametrize("damaged", ["near", "far", "left", "modes", "cluster"])
def test_arrays_that_do_not_fit_together_are_refused(clustered, damaged) -> None:
    arrays = cluster_files.arrays_of(clustered)
    assert_array_equal(
        compliance_of(arrays, clustered.unknowns, where="here", remake="again").dense(), clustered.dense(),
    )
    if damaged in ("modes", "cluster"):
        arrays[damaged] = arrays[damaged] + 1
    else:
        arrays[damaged] = np.concatenate([arrays[damaged], arrays[damaged][:1]])
    with pytest.raises(InputError, match="as its clusters say, got"):
        compliance_of(arrays, clustered.unknowns, where="here", remake="again")


def test_what_earlier_versions_wrote_is_read(mesh, prior, tmp_path) -> None:
    prior.save(tmp_path, packed=True)
    own, soft = prior._own_unknowns(), prior.coordinates.n_soft
    unknowns = np.concatenate([own, np.arange(soft, prior.coordinates.size)])
    inside = np.setdiff1d(np.arange(prior.coordinates.size), unknowns)
    whole = np.asarray(prior.compliance.matrix)
    rows = Rows.of(whole[:, inside], integers=True)
    for name in cluster_files.SPECS:
        (tmp_path / f"{name}.npy").unlink()
    for name, array in (("numbers", rows.numbers), ("scale", rows.scale), ("exact", whole[:, unknowns])):
        np.save(tmp_path / f"{name}.npy", array)
    about = json.loads((tmp_path / "prior.json").read_text())
    about["packed"] = True
    del about["clustered"]
    (tmp_path / "prior.json").write_text(json.dumps(about))
    PRIOR.seal(tmp_path, ["prior.json", "numbers.npy", "scale.npy", "exact.npy"])
    found = ElasticPrior.load(tmp_path, mesh).compliance
    chosen, force = rows_of(np.array([3, 1])), np.arange(1.0, 7.0)
    assert_allclose(found.respond(chosen, force), force @ whole[chosen], atol=1e-4 * np.abs(whole).max())


@pytest.mark.parametrize("integers", [True, False])
def test_rows_are_those_of_their_matrix(integers) -> None:
    rng = np.random.default_rng(7)
    matrix = rng.normal(size=(9, 5000)).astype(np.float32)
    rows = Rows.of(matrix, integers=integers)
    scale = np.abs(matrix).max(axis=1, keepdims=True) / 65_534.0 if integers else np.zeros((9, 1))
    assert (np.abs(rows.dense() - matrix) <= 1.01 * scale).all()
    dense, vector, factors = rows.dense().astype(np.float64), rng.normal(size=5000).astype(np.float32), np.ones(9)
    assert_allclose(rows.times(vector), dense @ vector, atol=2e-3)
    assert_allclose(rows.times(vector, np.array([4, 2])), (dense @ vector)[[4, 2]], atol=2e-3)
    out = np.ones(5000, np.float32)
    rows.add_to(out, factors.astype(np.float32))
    assert_allclose(out, 1.0 + dense.sum(axis=0), atol=1e-4)
    assert len(rows) == 9
    assert rows.packed().scale is not None
