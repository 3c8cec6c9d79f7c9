import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from mixpinn.fem.rigid.parts import RigidParts, geometric_stiffness
from mixpinn.geometry.rotations import orthonormalise, rotation_from_vector, skew, vector_from_rotation

component = st.floats(-1.8, 1.8, allow_nan=False)
vectors = st.tuples(component, component, component).map(np.array)


@settings(max_examples=40, deadline=None)
@given(vector=vectors)
def test_rotation_is_the_matrix_exponential(vector):
    rotation = rotation_from_vector(vector)
    np.testing.assert_allclose(rotation, expm(skew(vector)), atol=1e-13)
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-14)


@settings(max_examples=60, deadline=None)
@given(vector=vectors, scale=st.sampled_from([1.0, 1e-3, 1e-9, 0.0]))
def test_vector_of_a_rotation_round_trips(vector, scale):
    vector = vector * scale
    if np.linalg.norm(vector) < np.pi - 1e-6:
        np.testing.assert_allclose(vector_from_rotation(rotation_from_vector(vector)), vector, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_have_a_vector(axis):
    vector = np.zeros(3)
    vector[axis] = np.pi
    np.testing.assert_allclose(np.abs(vector_from_rotation(rotation_from_vector(vector))), vector, atol=1e-12)


def test_skew_is_the_cross_product():
    a, b = np.random.default_rng(0).normal(size=(2, 4, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(a), b), np.cross(a, b), atol=1e-15)


def test_orthonormalise_restores_a_rotation():
    rotation = rotation_from_vector(np.array([[0.3, -1.0, 0.4], [2.0, 0.1, 0.0]]))
    found = orthonormalise(rotation + 1e-9 * np.random.default_rng(0).normal(size=(2, 3, 3)))
    np.testing.assert_allclose(found @ np.swapaxes(found, 1, 2), np.tile(np.eye(3), (2, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(found, rotation, atol=1e-8)


def test_geometric_stiffness_is_the_second_derivative():
    arms, forces = np.random.default_rng(1).normal(size=(2, 5, 3))
    h, units = 1e-3, np.eye(3)

    def work(vector):
        return float((forces * (arms @ rotation_from_vector(vector).T)).sum())

    second = np.array([[
        (work(h * (a + b)) - work(h * (a - b)) - work(h * (b - a)) + work(-h * (a + b))) / (4.0 * h * h) for b in units
    ] for a in units])
    np.testing.assert_allclose(geometric_stiffness(arms, forces), second, atol=1e-5)


def test_parts_carry_their_nodes():
    # Part 1 is nodes 0 and 1 with centroid (1, 0, 0), turned by 90° about z and raised by 5; node 2 is no part's.
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [9.0, 9.0, 9.0]])
    parts = RigidParts(points, np.array([1, 1, 0]), 1)
    turn, shift = rotation_from_vector(np.array([[0.0, 0.0, np.pi / 2]])), np.array([[0.0, 0.0, 5.0]])
    moved = points.copy()
    parts.place(moved, turn, shift)
    np.testing.assert_allclose(moved, [[1.0, -1.0, 5.0], [1.0, 1.0, 5.0], [9.0, 9.0, 9.0]], atol=1e-15)
    # Forces ±x at arms ∓y: a pure moment about z of 1·1 + 1·1.
    nodal = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [7.0, 7.0, 7.0]])
    np.testing.assert_allclose(parts.wrench(nodal, moved, shift), [[0.0, 0.0, 0.0, 0.0, 0.0, 2.0]], atol=1e-15)
    arms = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(parts.arms(moved, shift), arms, atol=1e-15)
    out = np.zeros((3, 3))  # δt = (0, 0, 1), δw = (0, 0, 2): δx = δt + δw × d
    parts.expand(np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 2.0]]), np.array(arms), out)
    np.testing.assert_allclose(out, [[2.0, 0.0, 1.0], [-2.0, 0.0, 1.0], [0.0, 0.0, 0.0]], atol=1e-15)
