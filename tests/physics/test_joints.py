"""Laws of joints and relative motion: finite differences, objectivity, balance of wrenches, closed forms."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.geometry.rotations import rotation_from_vector, vector_from_rotation
from mixpinn.physics.joint_motion import (
    CarriedFrame,
    inverse_right_jacobian,
    motion_curvature,
    motion_gradient,
    relative_motion,
)
from mixpinn.physics.joints import JointLaw, LinearBushing, NeutralZoneBushing


def full_bushing() -> LinearBushing:
    root = np.random.default_rng(4).normal(size=(6, 6)) * [10.0, 8.0, 30.0, 200.0, 150.0, 220.0]
    return LinearBushing((root.T @ root).tolist())


def zone_bushing() -> NeutralZoneBushing:
    return NeutralZoneBushing(
        (5.0, 5.0, 50.0, 900.0, 800.0, 700.0), (80.0, 90.0, 1400.0, 3e4, 4e4, 5e4),
        (70.0, 60.0, 1000.0, 2e4, 3e4, 6e4), (0.2, 0.3, 0.05, 0.03, 0.02, 0.01), (0.3, 0.2, 0.1, 0.05, 0.05, 0.02),
        (1.0, -2.0, 250.0, 30.0, 40.0, -10.0),
    )


LAWS = [full_bushing(), zone_bushing()]


def pose(rng: np.random.Generator, angle: float) -> CarriedFrame:
    axis = rng.normal(size=3)
    turn = rotation_from_vector(angle * axis / np.linalg.norm(axis))
    return CarriedFrame(turn, rng.normal(size=3) * 10.0, rng.normal(size=3) * 20.0)


def moved(frame: CarriedFrame, twist: np.ndarray) -> CarriedFrame:
    turn = rotation_from_vector(twist[3:])
    return CarriedFrame(turn @ frame.axes, turn @ frame.arm, frame.centroid + twist[:3])


def pair(angle: float, seed: int = 0) -> tuple[CarriedFrame, CarriedFrame]:
    """Two frames turned by `angle` against each other, some millimetres apart."""
    rng = np.random.default_rng(seed)
    first = pose(rng, 1.3)
    axis = rng.normal(size=3)
    axes = first.axes @ rotation_from_vector(angle * axis / np.linalg.norm(axis))
    arm = rng.normal(size=3) * 10.0
    return first, CarriedFrame(axes, arm, first.origin + rng.normal(size=3) * 0.4 - arm)


@pytest.mark.parametrize("law", LAWS)
def test_wrench_and_tangent_are_derivatives_of_the_energy(law: JointLaw) -> None:
    """Central differences of a law by its motion, inside and beyond the neutral zone."""
    rng = np.random.default_rng(1)
    for size in (0.02, 1.0):
        q = rng.normal(size=6) * [0.5, 0.5, 0.2, 0.1, 0.1, 0.1] * size
        way = rng.normal(size=6) * [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]
        h = 1e-5
        slope = (law.energy(q + h * way) - law.energy(q - h * way)) / (2.0 * h)
        assert slope == pytest.approx(float(law.wrench(q) @ way), rel=1e-6)
        change = (law.wrench(q + h * way) - law.wrench(q - h * way)) / (2.0 * h)
        np.testing.assert_allclose(change, law.tangent(q) @ way, rtol=1e-6, atol=1e-6 * np.abs(change).max())


@pytest.mark.parametrize("angle", [0.0, 1e-4, 0.1, 0.39, 0.41, 1.5, 3.0])
@pytest.mark.parametrize("law", LAWS)
def test_energy_wrench_and_tangent_of_two_parts(law: JointLaw, angle: float) -> None:
    """Energy → wrenches on both parts → Hessian of E∘advance, through finite rotations."""
    first, second = pair(angle, seed=2)

    def energy(twist: np.ndarray) -> float:
        return law.energy(relative_motion(moved(first, twist[:6]), moved(second, twist[6:])))

    q = relative_motion(first, second)
    gradient = motion_gradient(first, second).T @ law.wrench(q)
    rate = motion_gradient(first, second)
    hessian = rate.T @ law.tangent(q) @ rate + motion_curvature(first, second, law.wrench(q))
    np.testing.assert_allclose(hessian, hessian.T, rtol=0.0, atol=1e-12 * np.abs(hessian).max())
    scale = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05] * 2)
    rng = np.random.default_rng(3)
    h = 3e-4
    for _ in range(6):
        way = rng.normal(size=12) * scale
        values = [energy(step * h * way) for step in (-2, -1, 1, 2)]
        slope = (8.0 * (values[2] - values[1]) - (values[3] - values[0])) / (12.0 * h)
        assert slope == pytest.approx(float(gradient @ way), rel=1e-6, abs=1e-6 * np.abs(gradient * way).max())

    # The Hessian as derivative of the gradient: to 1e-6. The gradient at a state moved by w is the derivative by a
    # further twist v; exp(v) exp(w) = exp(w + v + ½ v × w + …), so its rotations' rows lack ½ m × w.
    for _ in range(3):
        way = rng.normal(size=12) * scale
        change = np.zeros(12)
        for sign, weight in ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0)):
            a, b = moved(first, sign * h * way[:6]), moved(second, sign * h * way[6:])
            change += weight / (12.0 * h) * motion_gradient(a, b).T @ law.wrench(relative_motion(a, b))
        for part in (3, 9):
            change[part:part + 3] += 0.5 * np.cross(gradient[part:part + 3], way[part:part + 3])
        np.testing.assert_allclose(change, hessian @ way, rtol=0.0, atol=1e-6 * np.abs(hessian @ way).max())


@pytest.mark.parametrize("law", LAWS)
def test_objective_and_balanced(law: JointLaw) -> None:
    """A rigid motion of both parts changes nothing to 1e-12; the wrenches are equal and opposite to 1e-10."""
    rng = np.random.default_rng(5)
    first, second = pair(0.3, seed=6)
    q = relative_motion(first, second)
    for _ in range(10):
        turn, shift = rotation_from_vector(rng.normal(size=3) * 2.0), rng.normal(size=3) * 10.0
        a, b = (
            CarriedFrame(turn @ f.axes, turn @ f.arm, turn @ f.centroid + shift) for f in (first, second)
        )
        np.testing.assert_allclose(relative_motion(a, b), q, rtol=0.0, atol=1e-12)
        assert law.energy(relative_motion(a, b)) == pytest.approx(law.energy(q), rel=1e-12)
        g = motion_gradient(a, b).T @ law.wrench(relative_motion(a, b))
        force, moment = g[:3] + g[6:9], g[3:6] + g[9:] + np.cross(a.centroid, g[:3]) + np.cross(b.centroid, g[6:9])
        assert np.abs(force).max() <= 1e-10 * np.abs(g[:3]).max()
        assert np.abs(moment).max() <= 1e-10 * np.abs(g[3:]).max()


def test_motion_is_what_a_testing_machine_measures() -> None:
    """First part clamped, second moved by u and turned by θ about the joint's own axes: q is just that."""
    axes = rotation_from_vector(np.array([0.2, -0.4, 0.1]))
    origin, turn, shift = np.array([1.0, 2.0, 3.0]), np.array([0.3, 0.1, -0.2]), np.array([0.5, -1.0, 0.2])
    first = CarriedFrame(axes, origin - 5.0, np.full(3, 5.0))
    arm = np.array([1.0, 0.0, 0.0])
    second = CarriedFrame(axes @ rotation_from_vector(turn), arm, origin + axes @ shift - arm)
    np.testing.assert_allclose(relative_motion(first, second), [*shift, *turn], atol=1e-13)


def test_derivative_of_the_logarithm() -> None:
    """B(θ) s is the derivative of log(exp([θ]) exp([h s])), on both sides of where the series ends."""
    rng = np.random.default_rng(8)
    for angle in (0.0, 1e-6, 0.399, 0.401, 2.0, 3.1):
        axis, s, h = rng.normal(size=3), rng.normal(size=3), 1e-4
        theta = angle * axis / np.linalg.norm(axis)
        ends = [
            vector_from_rotation(rotation_from_vector(theta) @ rotation_from_vector(k * h * s)) for k in (-2, -1, 1, 2)
        ]
        slope = (8.0 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / (12.0 * h)
        np.testing.assert_allclose(inverse_right_jacobian(theta) @ s, slope, atol=1e-9)


def test_neutral_zone() -> None:
    """Within the zone only the lax stiffness; far beyond, the slope of the side; the preload at rest."""
    law = zone_bushing()
    np.testing.assert_array_equal(law.wrench(np.zeros(6)), law.preload)
    inside = 0.9 * np.array(law.zone)
    np.testing.assert_allclose(law.wrench(inside) - law.preload, np.array(law.lax) * inside, rtol=1e-12)
    np.testing.assert_array_equal(np.diagonal(law.tangent(np.full(6, 3.0))), law.positive)
    np.testing.assert_array_equal(np.diagonal(law.tangent(np.full(6, -3.0))), law.negative)


@pytest.mark.parametrize("make", [
    lambda: LinearBushing.of_diagonal([1.0, 2.0]),
    lambda: LinearBushing.of_diagonal([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]),
    lambda: LinearBushing((np.eye(6) + np.eye(6, k=1)).tolist()),
    lambda: NeutralZoneBushing(*([(1.0,) * 6] * 2), (0.5,) * 6, (0.1,) * 6, (0.1,) * 6),
    lambda: NeutralZoneBushing(*([(1.0,) * 6] * 3), (0.1,) * 6, (0.0,) * 6),
    lambda: NeutralZoneBushing(*([(float("nan"),) * 6] * 3), (0.1,) * 6, (0.1,) * 6),
])
def test_laws_out_of_range_are_refused(make: object) -> None:
    with pytest.raises(InputError, match="bushing"):
        make()  # type: ignore[operator]
