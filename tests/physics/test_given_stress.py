import numpy as np

from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics.energies import LOCAL_PAIRS
from mixpinn.physics.given_stress import cell_blocks_of_tangent, cell_forces_of_stress

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def test_forces_are_the_stress_on_the_faces():
    # Unit tetrahedron: V G_1 = (1/6, 0, 0), so that node 1 takes a sixth of the first column of P.
    gradients, volumes = shape_gradients(POINTS, np.array([[0, 1, 2, 3]]))
    stress, out = np.arange(9.0).reshape(1, 3, 3), np.empty((1, 4, 3))
    cell_forces_of_stress(0, 1, stress, gradients, volumes, out)
    np.testing.assert_allclose(out[0], np.array([[-3, -12, -21], [0, 3, 6], [1, 4, 7], [2, 5, 8]]) / 6.0)


def test_blocks_contract_the_tangent_with_both_gradients():
    rng = np.random.default_rng(0)
    gradients, volumes = shape_gradients(rng.normal(size=(4, 3)), np.array([[0, 1, 2, 3]]))
    tangent, out = rng.normal(size=(1, 9, 9)), np.empty((1, 6, 3, 3))
    cell_blocks_of_tangent(0, 1, tangent, gradients, volumes, out)
    full = np.einsum("m,maj,mijkl,mbl->mabik", volumes, gradients, tangent.reshape(1, 3, 3, 3, 3), gradients)
    for pair, (a, b) in enumerate(LOCAL_PAIRS):
        np.testing.assert_allclose(out[:, pair], full[:, a, b], rtol=1e-12, atol=1e-12)
