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
    law = PoseErrorLaw.fit(signs, errors, penalty=1e-9)
    assert_allclose([law.expected(sign) for sign in signs], errors, rtol=1e-6)
    assert_allclose(law.factor, 1.0, rtol=1e-6)


def test_bounds_cover_new_answers_and_are_not_wide() -> None:
    law = PoseErrorLaw.fit(*answers(2000, 1))
    signs, errors = answers(4000, 2)
    bounds = law.factor * np.array([law.expected(sign) for sign in signs])
    coverage = (errors <= bounds).mean(axis=0)
    assert ((coverage > 0.92) & (coverage < 0.99)).all()
    assert (np.median(bounds, axis=0) < 3.0 * np.median(errors, axis=0)).all()


def test_errors_that_happen_to_be_small_do_not_bend_it() -> None:
    """Of normal errors in one direction, whose logarithms scatter widely towards small ones, the scale is found."""
    rng = np.random.default_rng(3)
    signs = np.exp(rng.normal(size=(3000, 1)))
    errors = np.abs(rng.normal(size=(3000, 3))) * 0.2 * np.sqrt(signs)
    law = PoseErrorLaw.fit(signs, errors)
    assert_allclose(law.coefficients, np.tile([np.log(0.2), 0.5], (3, 1)), atol=0.06)
    assert_allclose(law.factor, 1.96, rtol=0.05)  # 95 % of a normal error


def test_signs_that_a_law_was_not_fitted_with_do_not_count() -> None:
    law = PoseErrorLaw.fit(*answers(200, 1))
    assert_allclose(law.expected([0.3, 2.0, 77.0]), law.expected([0.3, 2.0]))


def test_plain_values_keep_a_law() -> None:
    law = PoseErrorLaw.fit(*answers(40, 1))
    kept = PoseErrorLaw.of_dict(law.as_dict())
    assert_allclose(kept.coefficients, law.coefficients)
    assert_allclose(kept.factor, law.factor)
