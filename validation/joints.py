"""Joints: derivatives, objectivity, balance, a chain against its closed form, presets against published figures."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import Joint, JointFrame, JointLaw, LinearBushing, NeutralZoneBushing, preset_joints
from mixpinn.fem.rigid.joint_presets import FACTORS, IN_VITRO
from mixpinn.fem.rigid.sourced_stiffness import NEWTON_METRE_PER_DEGREE
from mixpinn.geometry.rotations import rotation_from_vector, skew, vector_from_rotation
from mixpinn.physics.joint_system import JointSystem
from validation.result import Result, Section, picture

_ROOT = np.random.default_rng(4).normal(size=(6, 6)) * [10.0, 8.0, 30.0, 200.0, 150.0, 220.0]
LAWS: dict[str, JointLaw] = {
    "linear bushing": LinearBushing((_ROOT.T @ _ROOT).tolist()),
    "neutral zone": NeutralZoneBushing(
        (5.0, 5.0, 50.0, 900.0, 800.0, 700.0), (80.0, 90.0, 1400.0, 3e4, 4e4, 5e4),
        (70.0, 60.0, 1000.0, 2e4, 3e4, 6e4), (0.2, 0.3, 0.05, 0.03, 0.02, 0.01), (0.3, 0.2, 0.1, 0.05, 0.05, 0.02),
        (1.0, -2.0, 250.0, 30.0, 40.0, -10.0),
    ),
}


def chain(laws: Sequence[JointLaw], spacing: float = 30.0) -> JointSystem:
    """A straight chain along z of bodies whose centroids are `spacing` [mm] apart, joints halfway."""
    names = [f"body{i}" for i in range(len(laws) + 1)]
    frames = [
        JointFrame(low, high, (0.0, 0.0, -spacing * (i + 0.5)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), spacing)
        for i, (low, high) in enumerate(pairwise(names))
    ]
    centroids = np.array([[0.0, 0.0, -spacing * i] for i in range(len(names))])
    return JointSystem([Joint(frame, law) for frame, law in zip(frames, laws, strict=True)], names, centroids)


def hang(system: JointSystem, n_bodies: int, load: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations and translations in equilibrium, the first body held, a constant force and moment (6,) on the last."""
    rotation, translation = np.tile(np.eye(3), (n_bodies, 1, 1)), np.zeros((n_bodies, 3))
    for share in np.linspace(0.1, 1.0, 10):
        for _ in range(30):
            inner = system.gradient(rotation, translation)
            residual = inner[1:].copy()
            residual[-1] -= share * load
            matrix = np.zeros((6 * n_bodies, 6 * n_bodies))
            system.add_tangent(rotation, translation, matrix)
            for k, moment in enumerate(inner[:, 3:]):  # the slope of the residual itself: see ElasticSystem
                matrix[6 * k + 3:6 * k + 6, 6 * k + 3:6 * k + 6] -= 0.5 * skew(moment)
            step = np.linalg.solve(matrix[6:, 6:], -residual.ravel()).reshape(-1, 6)
            translation[1:] += step[:, :3]
            rotation[1:] = rotation_from_vector(step[:, 3:]) @ rotation[1:]
            if np.abs(step).max() < 1e-13:
                break
    return rotation, translation


def derivative_errors(law: JointLaw) -> tuple[float, float]:
    """Largest relative error of wrenches against energies and of the tangent against wrenches, by differences."""
    rng, system = np.random.default_rng(1), chain([law])
    errors, h = [(0.0, 0.0)], 3e-4
    for angle in (0.0, 0.05, 0.5, 1.5, 2.8):
        turn = rotation_from_vector(rng.normal(size=(2, 3)) * [[1.0], [0.0]])
        axis = rng.normal(size=3)
        turn[1] = turn[0] @ rotation_from_vector(angle * axis / np.linalg.norm(axis))
        shift = rng.normal(size=(2, 3))
        gradient, matrix = system.gradient(turn, shift), np.zeros((12, 12))
        system.add_tangent(turn, shift, matrix)
        way = rng.normal(size=(2, 6)) * ([1.0] * 3 + [0.05] * 3)
        slope, change = 0.0, np.zeros((2, 6))
        for step, weight in ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0)):
            moved = rotation_from_vector(step * h * way[:, 3:]) @ turn, shift + step * h * way[:, :3]
            slope += weight / (12.0 * h) * system.energy(*moved)
            change += weight / (12.0 * h) * system.gradient(*moved)
        change[:, 3:] += 0.5 * np.cross(gradient[:, 3:], way[:, 3:])
        expected = matrix @ way.ravel()
        errors.append((
            abs(slope - (gradient * way).sum()) / np.abs(gradient * way).sum(),
            float(np.abs(change.ravel() - expected).max() / np.abs(expected).max()),
        ))
    wrench, tangent = np.max(errors, axis=0)
    return float(wrench), float(tangent)


def invariance_errors(law: JointLaw) -> tuple[float, float]:
    """Relative change of the energy under rigid motions of both parts, and the sum of both wrenches."""
    rng, system = np.random.default_rng(2), chain([law])
    centroids = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -30.0]])
    turn, shift = rotation_from_vector(0.3 * rng.normal(size=(2, 3))), rng.normal(size=(2, 3))
    energy, change, left = system.energy(turn, shift), 0.0, 0.0
    for _ in range(20):
        about, by = rotation_from_vector(rng.normal(size=3)), 10.0 * rng.normal(size=3)
        moved = about @ turn, (centroids + shift) @ about.T + by - centroids
        change = max(change, abs(system.energy(*moved) / energy - 1.0))
        wrench = system.gradient(*moved)
        moment = wrench[:, 3:] + np.cross(centroids + moved[1], wrench[:, :3])
        left = max(
            left, np.abs(wrench[:, :3].sum(axis=0)).max() / np.abs(wrench[:, :3]).max(),
            np.abs(moment.sum(axis=0)).max() / np.abs(moment).max(),
        )
    return change, left


def chain_error(draw: list[FloatArray] | None = None) -> float:
    """Five bushings under a force across and along them and a moment, against statics from the tip; relative.

    Turns stay about x. Joint i carries the force, in the axes of the body below, and the moment about where the body
    above is joined; from these φ and the places follow body by body, iterated until they stand still.
    """
    stiffness = np.array([[50.0 + i, 60.0 - i, 300.0, 2e4, 3e4, 4e4 + 1e3 * i] for i in range(5)])
    force, moment, half = np.array([0.0, 6.0, 15.0]), np.array([2500.0, 0.0, 0.0]), np.array([0.0, 0.0, -15.0])
    rotation, translation = hang(
        chain([LinearBushing.of_diagonal(row.tolist()) for row in stiffness]), 6, np.concatenate([force, moment]),
    )
    phi = np.zeros(6)
    for _ in range(2000):
        turn = rotation_from_vector(np.outer(phi, [1.0, 0.0, 0.0]))
        centre, joined = np.zeros((6, 3)), np.zeros((5, 3))
        for i in range(5):
            joined[i] = centre[i] + turn[i] @ (half + (turn[i].T @ force) / stiffness[i, :3])
            centre[i + 1] = joined[i] + turn[i + 1] @ half
        bending = (moment + np.cross(centre[5] - joined, force))[:, 0] / stiffness[:, 3]
        last, phi = phi, np.concatenate([[0.0], np.cumsum(bending)])
        if np.abs(phi - last).max() < 1e-16:
            break
    places = translation + np.arange(6)[:, None] * 2.0 * half
    if draw is not None:
        draw.extend([places, centre])
    turns = vector_from_rotation(rotation)[:, 0]
    return float(max(
        np.abs(turns - phi).max() / np.abs(phi).max(), np.abs(places - centre).max() / np.abs(centre).max(),
    ))


def lumbar_frames(
    spacings: Sequence[float] = (36.0, 37.0, 37.0, 36.0), lordosis: float = 9.0,
) -> tuple[JointFrame, ...]:
    """Joints L1-L2 … L4-L5 of bodies `spacings` [mm] apart on an arc that turns by `lordosis` [degree] a level."""
    frames, place = [], np.zeros(3)
    for i, spacing in enumerate(spacings):
        axes = rotation_from_vector(np.array([-np.deg2rad(lordosis) * (i - 1.5), 0.0, 0.0])).T
        middle, place = place + 0.5 * spacing * axes[2], place + spacing * axes[2]
        frames.append(JointFrame.of_arrays(
            f"vertebrae_L{i + 2}", f"vertebrae_L{i + 1}", origin=middle, axes=axes, spacing=spacing,
        ))
    return tuple(frames)


def measured_stiffness(joint: Joint) -> FloatArray:
    """Loads over motions along and about the joint's axes, one small load at a time, the first part clamped, (6,)."""
    frame, found = joint.frame, np.empty(6)
    system = JointSystem([joint], (frame.first, frame.second), np.tile(frame.centre, (2, 1)))
    for i in range(6):
        load = np.zeros((2, 3))
        load[i // 3] = (1.0 if i < 3 else 100.0) * frame.columns[:, i % 3]
        rotation, translation = hang(system, 2, load.ravel())
        motion = np.concatenate([translation[1] @ frame.columns, vector_from_rotation(rotation[1]) @ frame.columns])
        found[i] = np.linalg.norm(load) / motion[i]
    return found


def chain_bending_stiffness(joints: Sequence[Joint], moment: float = 5e3) -> float:
    """Moment over curvature of a lumbar chain in pure flexion [N mm²]; the caudal body is held."""
    order = [joints[-1].frame.first, *[joint.frame.second for joint in reversed(joints)]]
    centres = [joints[-1].frame.centre] + [joint.frame.centre for joint in reversed(joints)]
    system = JointSystem(joints, order, np.array(centres))
    rotation, _ = hang(system, len(order), np.array([0.0, 0.0, 0.0, -moment, 0.0, 0.0]))
    curvature = -vector_from_rotation(rotation[-1])[0] / sum(joint.frame.spacing for joint in joints)
    return float(moment / curvature)


def run(folder: Path) -> Section:
    """The checks of the joints."""
    results = []
    for name, law in LAWS.items():
        wrench, tangent = derivative_errors(law)
        objective, left = invariance_errors(law)
        results += [
            Result.at_most(f"wrench against energy, {name}", wrench, 1e-6),
            Result.at_most(f"tangent against wrench, {name}", tangent, 1e-6),
            Result.at_most(f"objectivity, {name}", objective, 1e-12),
            Result.at_most(f"equal and opposite wrenches, {name}", left, 1e-10),
        ]
    shapes: list[FloatArray] = []
    bent = chain_error(shapes)
    results.append(Result.at_most("chain of five bushings under force and moment, closed form", bent, 1e-8))
    segments = np.array([measured_stiffness(joint) for joint in preset_joints(lumbar_frames(), "in-vitro")])
    table = [("motion", "in vitro", "published", "source", "in vivo, prone")]
    for i, entry in enumerate(IN_VITRO):
        unit, size = (" N/mm", 1.0) if i < 3 else (" N m/°", NEWTON_METRE_PER_DEGREE)
        low, high = entry.low / size, entry.high / size
        far = int(np.abs(segments[:, i] - 0.5 * (entry.low + entry.high)).argmax())
        results.append(Result.within(f"in vitro, {entry.name}", segments[far, i] / size, low, high, unit))
        table.append((
            entry.name, f"{entry.value / size:g}{unit}", f"{low:g} … {high:g}{unit}", entry.source, FACTORS[entry.name],
        ))
    bending = chain_bending_stiffness(preset_joints(lumbar_frames(), "in-vivo-prone"))
    soft = chain_bending_stiffness(preset_joints(lumbar_frames(), "in-vitro"))
    results.append(Result.within("in vivo, prone: EI of L1 … L5 in pure bending", bending / 1e6, 34.65, 42.35, " N m²"))

    def draw(axes: Any) -> None:
        axes.plot(shapes[1][:, 1], -shapes[1][:, 2], "-", color="#4477aa", label="closed form")
        axes.plot(shapes[0][:, 1], -shapes[0][:, 2], "o", color="#ee6677", markersize=4, label="Newton")
        axes.set(xlabel="across [mm]", ylabel="along [mm]", aspect="equal")
        axes.legend(frameon=False)

    text = (
        "Two parts turned by up to 2.8 rad against each other: wrenches on both parts and Hessian of the energy "
        "against central differences of fourth order. Objectivity: the energy under rigid motions of both. A straight "
        "chain of five bushings is bent by a force and a moment at its end, against statics from the tip. Presets: "
        "each motion segment is loaded as in a testing machine, the caudal part clamped. EI is the moment over the "
        f"curvature of the chain L1 … L5 in flexion; with the in-vitro stiffness it is {soft / 1e6:.1f} N m². "
        "Flexion-extension alone is fitted to EI, which it reproduces by construction; all others are scaled for a "
        "preload. Sources that were read as abstracts only are marked."
    )
    return Section("Joints", text, tuple(results), picture(folder, "joints", draw, size=(3.4, 3.4)), tuple(table))
