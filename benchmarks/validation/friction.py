"""Friction: a block pressed by a plate that is then moved along it."""

from pathlib import Path

import numpy as np

from benchmarks.validation.blocks import block, labelled
from benchmarks.validation.result import Result, Section, picture
from benchmarks.validation.watched import watch
from mixpinn.fem import ContactConfig, Scene, StableNeoHookean
from mixpinn.records import Probe, ProbePath

MU = 0.3
PRESS, DRAG, INCREMENT = 1.0, 4.0, 0.25


def run(folder: Path) -> Section:
    """The check."""
    mesh = block((4, 3, 4), size=(30.0, 15.0, 30.0))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 1] < 1e-9)
    # Contact points on the plate lie 10 mm apart, and none comes near a rim of the block, where the distance to the
    # rim would tilt the normal: the forces' sum then shows the law of each contact.
    low, high = -44.5, 45.5
    corners = np.array([[low, 0.0, low], [high, 0.0, low], [high, 0.0, high], [low, 0.0, high]])
    plate = Probe(corners, np.array([[0, 1, 2], [0, 2, 3]]), "plate")  # its normal points down
    gap = 1.0
    scene = Scene(
        mesh, plate, (StableNeoHookean.from_young(25.4e-3, 0.3),),
        ContactConfig(gap=gap, alarm=2.0, friction=MU, stiffness=50.0, spacing=15.0),
    )
    pressed = 15.0 + gap - np.array([-0.1, 0.5 * PRESS, PRESS])
    along = np.arange(INCREMENT, DRAG + 1e-9, INCREMENT)
    places = np.concatenate([
        [[15.0, y, 15.0] for y in pressed], [[15.0 + s, pressed[-1], 15.0] for s in along],
    ])
    path = ProbePath(places, np.tile(np.eye(3), (len(places), 1, 1)), np.maximum(15.0 + gap - places[:, 1], 0.0))
    watched = watch(scene, path)
    steps = range(2, len(places))
    total = np.array([watched.nodal_forces(step).sum(axis=0) for step in steps])
    normal, tangential = -total[:, 1], np.hypot(total[:, 0], total[:, 2])
    ratio = tangential / (MU * normal)
    slide = np.concatenate([[0.0], along])
    moved = np.array([watched.states[step].points[mesh.points[:, 1] > 15.0 - 1e-9, 0].mean() for step in steps])
    slip = slide - (moved - moved[0])  # of the plate over the block's top, on average
    results = [
        Result.at_most("friction, largest |T| / (μ N) at any increment", float(ratio.max()), 1.0),
        Result.within("friction, |T| / (μ N) while sliding", float(ratio[-1]), 0.99, 1.01),
        Result.at_most(
            "friction, slip while |T| < μ N, relative to the displacement", float(abs(slip[1] / slide[1])), 0.05,
        ),
        Result("friction, increments that converged", float(watched.simulation.converged.mean()), "= 1",
               bool(watched.simulation.converged.all())),
    ]

    def draw(axes):  # type: ignore[no-untyped-def]
        axes.plot(slide, ratio, "o-", markersize=3, label="|T| / (μ N)")
        axes.plot(slide, slip / DRAG, "s-", markersize=3, label="slip / largest displacement")
        axes.axhline(1.0, color="grey", linewidth=0.8, linestyle="--")
        axes.set(xlabel="displacement of the plate [mm]")
        axes.legend(frameon=False, fontsize=8)

    return Section(
        "Friction",
        f"A plate presses a block by {PRESS:g} mm and is then moved along it in steps of {INCREMENT:g} mm; μ = {MU:g}. "
        "The block shears under the sticking plate until |T| = μ N, and then the plate slides. Both are taken "
        "along the plate's plane; the block's top bulges by some hundredths of a millimetre, which tilts normals.",
        tuple(results), picture(folder, "friction", draw),
    )
