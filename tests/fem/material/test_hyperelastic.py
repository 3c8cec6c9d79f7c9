import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mixpinn.base.errors import InputError
from mixpinn.fem.material.hyperelastic import PAPER_TISSUE, LinearElastic, StableNeoHookean, StableNeoHookeanLog
from mixpinn.geometry.rotations import rotation_from_vector

MATERIALS = [
    PAPER_TISSUE, StableNeoHookean(mu=1.0, lam=2.0), StableNeoHookeanLog(mu=1.0, lam=2.0),
    StableNeoHookeanLog.from_young(25.4e-3, 0.45), LinearElastic(mu=1.0, lam=2.0),
]
OBJECTIVE = MATERIALS[:4]
finite = st.floats(-1.5, 1.5, allow_nan=False)


def deformations(seed: int = 0, m: int = 20, spread: float = 0.4) -> np.ndarray:
    return np.eye(3) + spread * np.random.default_rng(seed).normal(size=(m, 3, 3))


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_stress_and_tangent_are_derivatives(material):
    f, h = deformations(), 1e-5
    stress, tangent = material.gradient(f), material.hessian(f).reshape(-1, 3, 3, 3, 3)
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = h
            slope = (material.energy(f + step) - material.energy(f - step)) / (2.0 * h)
            assert np.abs(slope - stress[:, i, j]).max() <= 1e-6 * np.abs(stress).max()
            change = (material.gradient(f + step) - material.gradient(f - step)) / (2.0 * h)
            assert np.abs(change - tangent[:, :, :, i, j]).max() <= 1e-6 * np.abs(tangent).max()


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_rest_is_free_of_energy_and_stress_and_linearises_to_hooke(material):
    rest = np.eye(3)[None]
    assert abs(material.energy(rest)[0]) <= 1e-15 * material.mu
    assert np.abs(material.gradient(rest)).max() <= 1e-14 * (material.mu + material.lam)
    hooke = LinearElastic(material.mu, material.lam).hessian(rest)
    np.testing.assert_allclose(material.hessian(rest), hooke, atol=1e-13 * (material.mu + material.lam))


@pytest.mark.parametrize("material", OBJECTIVE, ids=repr)
@settings(max_examples=25, deadline=None)
@given(vector=st.tuples(finite, finite, finite), seed=st.integers(0, 1000))
def test_energy_and_stress_turn_with_the_body(material, vector, seed):
    f, turn = deformations(seed, 5), rotation_from_vector(np.array(vector))
    energy = material.energy(f)
    np.testing.assert_allclose(material.energy(turn @ f), energy, rtol=1e-11, atol=1e-11 * np.abs(energy).max())
    stress = material.gradient(f)
    np.testing.assert_allclose(material.gradient(turn @ f), turn @ stress, atol=1e-11 * np.abs(stress).max())


def test_energy_is_the_published_one():
    material, f = StableNeoHookean(mu=1.3, lam=7.1), deformations(3)
    alpha = 1.0 + material.mu / (material.lam + material.mu)

    def published(deformation):
        invariant = (deformation**2).sum(axis=(1, 2))
        return 0.65 * (invariant - 3.0) + 4.2 * (np.linalg.det(deformation) - alpha) ** 2

    np.testing.assert_allclose(material.energy(f), published(f) - published(np.eye(3)[None]), rtol=1e-11, atol=1e-12)


def test_logarithmic_energy_is_the_published_one():
    material, f = StableNeoHookeanLog(mu=0.75, lam=1.0 - 5.0 / 6.0 * 0.75), deformations(4)  # their μ = 1, λ = 1

    def published(deformation):
        invariant = (deformation**2).sum(axis=(1, 2))
        volume = (np.linalg.det(deformation) - (1.0 + 1.0 - 0.25)) ** 2
        return 0.5 * (invariant - 3.0) + 0.5 * volume - 0.5 * np.log(invariant + 1.0)

    np.testing.assert_allclose(material.energy(f), published(f) - published(np.eye(3)[None]), rtol=1e-11, atol=1e-12)


def test_youngs_modulus_gives_lame_constants():
    material = LinearElastic.from_young(25.4e-3, 0.45)
    assert material.mu == pytest.approx(8.7586207e-3, rel=1e-7)
    assert material.lam == pytest.approx(78.8275862e-3, rel=1e-7)


@pytest.mark.parametrize(("young", "poisson"), [(0.0, 0.3), (1.0, 0.5), (1.0, -1.0)])
def test_unstable_constants_are_refused(young, poisson):
    with pytest.raises(InputError, match="poisson"):
        StableNeoHookean.from_young(young, poisson)
    with pytest.raises(InputError, match="mu > 0"):
        StableNeoHookean(mu=-1.0, lam=1.0)
