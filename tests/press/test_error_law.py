"""Expected errors and bounds: the law is found, and the bound covers what it says."""

import numpy as np
from numpy.testing import assert_allclose

from mixpinn.press.error_law import PoseErrorLaw


def answers(n, seed, spread=0.3):
    """Signs (n, 2) and errors (n, 3) of a log-linear law up to a scatter, part of it shared by 20 in a row."""
    rng = np.random.default_rng(seed)
    signs = np.exp(rng.normal(size=(n, 2)))
    law = np.log(signs) @ [[0.5, 1.0, 0.0], [0.5, 0.0, 1.0]] + np.log([0.05, 0.5, 0.1])
    shared = np.repeat(rng.normal(size=(n // 20, 3)), 20, axis=0)
    return signs, np.exp(law + spread * (rng.normal(size=(n, 3)) + shared))


def test_an_exact_law_is_found() -> None:
    signs, errors = answers(200, 0, spread=0.0)
    law = PoseErrorLaw.fit(signs, errors, np.arange(200) // 10, penalty=1e-9)
    assert_allclose([law.expected(sign) for sign in signs], errors, rtol=1e-6)
    assert_allclose(law.factor, 1.0 + 0.3 / np.sqrt(20.0), rtol=1e-6)


def test_bounds_cover_new_answers_and_are_not_wide() -> None:
    law = PoseErrorLaw.fit(*answers(2000, 1), np.arange(2000) // 20)
    signs, errors = answers(4000, 2)
    bounds = law.factor * np.array([law.expected(sign) for sign in signs])
    coverage = (errors <= bounds).mean(axis=0)
    assert ((coverage > 0.92) & (coverage < 0.99)).all()
    assert (np.median(bounds, axis=0) < 3.0 * np.median(errors, axis=0)).all()


def test_plain_values_keep_a_law() -> None:
    law = PoseErrorLaw.fit(*answers(40, 1), np.arange(40) // 4)
    kept = PoseErrorLaw.of_dict(law.as_dict())
    assert_allclose(kept.coefficients, law.coefficients)
    assert_allclose(kept.factor, law.factor)
