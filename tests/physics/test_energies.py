"""The built-in energies at one point: stress by differences of the energy, small strains, objectivity, precision."""

import numpy as np
import pytest

from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.physics.energies import LINEAR, STABLE, STABLE_LOG, density, distribute, entries, stable_stress, stress

MU, LAM = 1.3, 4.1
KINDS = [STABLE, STABLE_LOG, LINEAR]


def energy(kind, h):
    return density(kind, MU, LAM, tuple(h.ravel()))


def piola(kind, h):
    return np.array(stress(kind, MU, LAM, tuple(h.ravel()), np.empty((3, 3)), np.empty((3, 3)))).reshape(3, 3)


@pytest.mark.parametrize("kind", KINDS)
def test_stress_is_the_derivative_of_the_energy(kind):
    h, step = 0.4 * np.random.default_rng(0).normal(size=(3, 3)), 1e-6
    slope = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            by = np.zeros((3, 3))
            by[i, j] = step
            slope[i, j] = (energy(kind, h + by) - energy(kind, h - by)) / (2.0 * step)
    np.testing.assert_allclose(piola(kind, h), slope, atol=1e-8 * np.abs(slope).max() + 1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_small_strains_obey_hooke_and_lose_no_digits(kind):
    h = 1e-9 * np.random.default_rng(1).normal(size=(3, 3))
    strain = 0.5 * (h + h.T)
    hooke = 2.0 * MU * strain + LAM * np.trace(strain) * np.eye(3)
    np.testing.assert_allclose(piola(kind, h), hooke, atol=1e-7 * np.abs(hooke).max())
    assert energy(kind, h) == pytest.approx(0.5 * (hooke * strain).sum(), rel=1e-7)


@pytest.mark.parametrize("kind", KINDS[:2])
def test_rotations_cost_nothing_and_turn_the_stress(kind):
    turn = rotation_from_vector(np.array([0.4, -1.1, 0.7]))
    deformation = np.eye(3) + 0.3 * np.random.default_rng(2).normal(size=(3, 3))
    assert abs(energy(kind, turn - np.eye(3))) < 1e-14
    assert np.abs(piola(kind, turn - np.eye(3))).max() < 1e-14
    turned = turn @ deformation - np.eye(3)
    assert energy(kind, turned) == pytest.approx(energy(kind, deformation - np.eye(3)), rel=1e-12)
    np.testing.assert_allclose(piola(kind, turned), turn @ piola(kind, deformation - np.eye(3)), atol=1e-12)


def test_one_law_in_both_precisions():
    h = (0.4 * np.random.default_rng(3).normal(size=9)).astype(np.float32)
    single = stable_stress(tuple(h), np.float32(MU), np.float32(LAM))
    assert all(isinstance(value, (float, np.float32)) for value in single)
    double = piola(STABLE, h.astype(np.float64).reshape(3, 3)).ravel()
    np.testing.assert_allclose(single, double, atol=2e-6 * np.abs(double).max())


def test_forces_of_a_stress_balance_and_do_its_work():
    rng = np.random.default_rng(4)
    p, gradient, out = rng.normal(size=(3, 3)), rng.normal(size=(4, 3)), np.empty((4, 3))
    gradient[0] = -gradient[1:].sum(axis=0)
    distribute(entries(p), gradient, 2.5, out)
    np.testing.assert_allclose(out.sum(axis=0), 0.0, atol=1e-12)
    moved = rng.normal(size=(4, 3))  # the work of the forces is V P : H
    assert (out * moved).sum() == pytest.approx(2.5 * (p * (moved.T @ gradient)).sum(), rel=1e-12)
