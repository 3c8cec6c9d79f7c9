"""Modes of responses: they span what they were drawn from, count each alike, and are orthonormal in the weights."""

import numpy as np
import pytest

from mixpinn.reduced.basis import response_modes, unlike


@pytest.fixture
def rows():
    """Twelve responses in a space of four dimensions, sizes from 1e-3 to 1e3."""
    rng = np.random.default_rng(0)
    size = np.logspace(-3, 3, 12)[:, None]
    return size * (rng.normal(size=(12, 4)) @ rng.normal(size=(4, 50)))


WEIGHTS = np.random.default_rng(1).uniform(0.5, 2.0, 50).astype(np.float32)


def test_they_span_the_responses_and_are_orthonormal(rows):
    modes = response_modes(rows, WEIGHTS, 4)
    assert modes.shape == (4, 50)
    np.testing.assert_allclose((modes * WEIGHTS**2) @ modes.T, np.eye(4), atol=1e-5)
    again = (rows * WEIGHTS**2) @ modes.T @ modes
    assert unlike(again, rows, WEIGHTS).max() < 1e-4


def test_size_does_not_matter_and_the_first_mode_is_the_commonest(rows):
    common = np.random.default_rng(2).normal(size=50)
    many = np.concatenate([np.outer([1e-3, 1.0, 1e3, 5.0, 0.2, 30.0], common), rows[:2]])
    first = response_modes(many, WEIGHTS, 1)[0]
    other = response_modes(many * np.logspace(2, -2, 8)[:, None], WEIGHTS, 1)[0]
    np.testing.assert_allclose(np.abs(first), np.abs(other), atol=1e-4)
    aligned = (first * WEIGHTS**2 * common).sum() / np.linalg.norm(WEIGHTS * common)
    assert abs(aligned) > 0.95


def test_unlike_is_the_relative_distance():
    fields = np.array([[3.0, 4.0], [1.0, 0.0]])
    found = np.array([[3.0, 4.0], [1.0, 0.5]])
    np.testing.assert_allclose(unlike(found, fields, np.array([1.0, 2.0], np.float32)), [0.0, 1.0])
