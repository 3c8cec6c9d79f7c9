import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mixpinn.geometry.rigid_fit import fit_rotation


@given(st.integers(0, 10_000), st.floats(-3.0, 3.0))
def test_exact_motion_is_recovered(seed, angle):
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(angle * rng.normal(size=3)).as_matrix()
    rest = rng.normal(size=(10, 3))
    np.testing.assert_allclose(fit_rotation(rest, rest @ rotation.T + [1.0, 2.0, 3.0]), rotation, atol=1e-8)


@given(st.integers(0, 10_000))
def test_noise_gives_the_rotation_that_an_independent_solver_finds(seed):
    rng = np.random.default_rng(seed)
    rest, moved = rng.normal(size=(2, 20, 3))
    expected, _ = Rotation.align_vectors(moved - moved.mean(axis=0), rest - rest.mean(axis=0))
    np.testing.assert_allclose(fit_rotation(rest, moved), expected.as_matrix(), atol=1e-6)


def test_a_reflection_is_not_a_rotation():
    rest = np.random.default_rng(0).normal(size=(12, 3))
    assert np.isclose(np.linalg.det(fit_rotation(rest, rest * [1.0, 1.0, -1.0])), 1.0)
