import numpy as np
import pytest

from mixpinn.fem.material.hyperelastic import StableNeoHookean, StableNeoHookeanLog
from mixpinn.physics.projection import negative_modes, project_tangents

RNG = np.random.default_rng(5)
TURN = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
CASES = {
    "rest": np.eye(3),
    "small strain": np.eye(3) + 1e-3 * RNG.normal(size=(3, 3)),
    "large strain": np.eye(3) + 0.5 * RNG.normal(size=(3, 3)),
    "inverted": np.diag([1.2, 0.9, -0.5]) @ TURN,
    "flat": TURN @ np.diag([1.1, 0.8, 0.0]),
    "line": TURN @ np.diag([1.1, 0.0, 0.0]),
    "point": np.zeros((3, 3)),
    "equal stretches": 0.7 * TURN * np.sign(np.linalg.det(TURN)),
    "squeezed": np.diag([0.3, 0.3, 1.0]),
    "stretched": np.diag([3.0, 1.0, 1.0]),
}


def coefficients(material, f):
    growth, trace = np.linalg.det(f) - 1.0, (f**2).sum() + 1.0
    if isinstance(material, StableNeoHookean):
        return material.mu, 0.0, material.lam + material.mu, (material.lam + material.mu) * growth - material.mu
    m, bulk = 4.0 / 3.0 * material.mu, material.lam + 5.0 / 6.0 * material.mu
    return m * (1.0 - 1.0 / trace), 2.0 * m / trace**2, bulk, bulk * growth - 0.75 * m


@pytest.mark.parametrize("material", [StableNeoHookean(1.0, 9.0), StableNeoHookeanLog(1.0, 9.0)], ids=["plain", "log"])
@pytest.mark.parametrize("case", CASES)
def test_analytic_projection_equals_clamped_eigenvalues(material, case):
    f = np.ascontiguousarray(CASES[case])
    modes, shifts = np.empty((9, 3, 3)), np.empty(9)
    count = negative_modes(f, *coefficients(material, f), modes, shifts, np.empty((6, 3, 3)))
    found = material.hessian(f[None])[0]
    scale = np.abs(found).max()
    for q, shift in zip(modes[:count].reshape(-1, 9), shifts[:count], strict=True):
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-9)
        np.testing.assert_allclose(found @ q, -shift * q, atol=1e-9 * scale)
    found = found + np.einsum("c,ci,cj->ij", shifts[:count], modes[:count].reshape(-1, 9), modes[:count].reshape(-1, 9))
    expected = material.hessian(f[None])
    project_tangents(expected)
    np.testing.assert_allclose(found, expected[0], atol=1e-9 * scale)


@pytest.mark.parametrize("spread", [1e-6, 1e-3, 0.1, 1.0])
def test_projection_of_many_random_deformations(spread):
    material = StableNeoHookean(1.0, 9.0)
    deformations = np.eye(3) + spread * np.random.default_rng(6).normal(size=(300, 3, 3))
    expected = material.hessian(deformations)
    changed = project_tangents(expected)
    assert changed.any()
    modes, shifts, work = np.empty((9, 3, 3)), np.empty(9), np.empty((6, 3, 3))
    for f, before, after in zip(deformations, material.hessian(deformations), expected, strict=True):
        count = negative_modes(f, *coefficients(material, f), modes, shifts, work)
        q = modes[:count].reshape(-1, 9)
        np.testing.assert_allclose(before + (q.T * shifts[:count]) @ q, after, atol=1e-9 * np.abs(before).max())


def test_positive_tangents_are_left_alone():
    tangents = np.tile(np.eye(9), (2, 1, 1))
    tangents[1, 0, 0] = -2.0
    assert project_tangents(tangents).tolist() == [False, True]
    np.testing.assert_array_equal(tangents[0], np.eye(9))
    np.testing.assert_allclose(tangents[1], np.diag([0.0] + [1.0] * 8), atol=1e-14)
