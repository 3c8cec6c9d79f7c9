"""Ridge regression: the normal equations, least squares without a penalty, and what scaling means."""

import numpy as np
from numpy.testing import assert_allclose

from mixpinn.reduced.ridge import column_deviations, column_norms, ridge


def samples():
    rng = np.random.default_rng(0)
    return rng.normal(size=(50, 4)) * [1.0, 10.0, 0.1, 3.0], rng.normal(size=(50, 2))


def test_without_penalty_it_is_least_squares_whatever_the_scale():
    x, y = samples()
    expected = np.linalg.lstsq(x, y, rcond=None)[0]
    for scale in (1.0, column_norms(x), column_deviations(x)):
        assert_allclose(ridge(x, y, penalty=0.0, scale=scale), expected, atol=1e-10)
    assert_allclose(ridge(x, y[:, 0], penalty=0.0), expected[:, 0], atol=1e-10)


def test_the_gradient_of_the_penalised_error_vanishes():
    x, y = samples()
    scale = column_deviations(x)
    gain = ridge(x, y, penalty=3.0, scale=scale)
    assert_allclose(x.T @ (x @ gain - y) + 3.0 * scale[:, None] ** 2 * gain, 0.0, atol=1e-9)


def test_scaled_features_give_the_same_prediction_in_other_units():
    x, y = samples()
    units = np.array([10.0, 0.1, 1.0, 1e3])
    for scale in (column_norms, column_deviations):
        one = x @ ridge(x, y, penalty=0.5, scale=scale(x))
        other = (x * units) @ ridge(x * units, y, penalty=0.5, scale=scale(x * units))
        assert_allclose(one, other, rtol=1e-9)
