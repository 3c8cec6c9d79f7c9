"""Products with chosen rows, and what several threads get from shared objects at once."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from mixpinn.fem import PAPER_TISSUE
from mixpinn.reduced.compliance.row_products import combine_rows, rows_times
from mixpinn.reduced.equilibrium import Equilibrium
from training.toy_block import block_mesh


def test_products_are_those_of_the_dense_rows():
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(30, 1001)).astype(np.float32)
    rows = rng.permutation(30)[:11]
    factors, vector = rng.normal(size=11).astype(np.float32), rng.normal(size=1001).astype(np.float32)
    out = np.ones(1001, np.float32)
    combine_rows(matrix, rows, factors, out)
    np.testing.assert_allclose(out, 1.0 + matrix[rows].astype(float).T @ factors, rtol=1e-4, atol=1e-4)
    out = np.empty(11, np.float32)
    rows_times(matrix, rows, vector, out)
    np.testing.assert_allclose(out, matrix[rows].astype(float) @ vector, rtol=1e-4, atol=1e-3)


def test_threads_that_share_one_equilibrium_get_what_one_gets():
    mesh = block_mesh()
    equilibrium = Equilibrium.of_materials(mesh, [PAPER_TISSUE])
    rng = np.random.default_rng(1)
    fields = [0.3 * rng.normal(size=mesh.points.shape) for _ in range(8)]
    expected = [equilibrium.nodal_forces(field) for field in fields]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(20):
            for found, alone in zip(pool.map(equilibrium.nodal_forces, fields), expected, strict=True):
                np.testing.assert_array_equal(found, alone)
