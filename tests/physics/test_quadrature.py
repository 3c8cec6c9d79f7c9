from itertools import product
from math import factorial

import numpy as np
import pytest

from mixpinn.physics.quadrature import TETRAHEDRON_RULES, TRIANGLE_3


@pytest.mark.parametrize("rule", [*TETRAHEDRON_RULES, TRIANGLE_3], ids=repr)
def test_every_monomial_up_to_the_degree_is_exact(rule):
    corners = rule.points.shape[1]
    np.testing.assert_allclose(rule.points.sum(axis=1), 1.0, atol=1e-15)
    for powers in product(range(rule.degree + 1), repeat=corners):
        if sum(powers) <= rule.degree:
            # mean of Π λ_i^p_i over a simplex of dimension d: d! Π p_i! / (d + Σ p_i)!
            expected = factorial(corners - 1) * np.prod([factorial(p) for p in powers])
            expected /= factorial(corners - 1 + sum(powers))
            assert rule.weights @ (rule.points ** np.array(powers)).prod(axis=1) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("rule", TETRAHEDRON_RULES, ids=repr)
def test_no_rule_is_better_than_it_says(rule):
    power = rule.degree + 1
    errors = [
        rule.weights @ (rule.points ** np.array(p)).prod(axis=1)
        - 6.0 * np.prod([factorial(k) for k in p]) / factorial(3 + power)
        for p in product(range(power + 1), repeat=4) if sum(p) == power
    ]
    assert np.abs(errors).max() > 1e-8
