"""Friction: a block pressed by a plate that is then moved along it."""

from pathlib import Path

import numpy as np

from mixpinn.fem import ContactConfig, Scene, StableNeoHookean
from mixpinn.records import Probe, ProbePath
from validation.blocks import block, labelled
from validation.contact.watched import Watched, watch
from validation.result import Result, Section, picture

MU = 0.3
PRESS, DRAG, INCREMENT = 1.0, 4.0, 0.25
GAP = 1.0
ALONG = np.arange(INCREMENT, DRAG + 1e-9, INCREMENT)

PLANE = Probe(
    np.array([[-300.0, 0.0, -100.0], [300.0, 0.0, -100.0], [0.0, 0.0, 300.0]]), np.array([[0, 1, 2]]), "plane",
)
"""One triangle, far larger than the block, its normal down: every contact is between a node and the plane."""
PLATE = Probe(
    np.array([[-44.5, 0.0, -44.5], [45.5, 0.0, -44.5], [45.5, 0.0, 45.5], [-44.5, 0.0, 45.5]]),
    np.array([[0, 1, 2], [0, 2, 3]]), "plate",
)
"""Two triangles with contact points of their own 10 mm apart, none of which comes near a rim of the block."""


def drag(plate: Probe, spacing: float) -> Watched:
    """Press the block with `plate`, whose contact points lie `spacing` [mm] apart, and drag it along."""
    mesh = block((4, 3, 4), size=(30.0, 15.0, 30.0))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 1] < 1e-9)
    scene = Scene(
        mesh, plate, (StableNeoHookean.from_young(25.4e-3, 0.3),),
        ContactConfig(gap=GAP, alarm=2.0, friction=MU, stiffness=50.0, spacing=spacing),
    )
    pressed = 15.0 + GAP - np.array([-0.1, 0.5 * PRESS, PRESS])
    places = np.concatenate([
        [[15.0, y, 15.0] for y in pressed], [[15.0 + s, pressed[-1], 15.0] for s in ALONG],
    ])
    return watch(scene, ProbePath(
        places, np.tile(np.eye(3), (len(places), 1, 1)), np.maximum(15.0 + GAP - places[:, 1], 0.0),
    ))


def resultants(watched: Watched) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """By increment: |T| / (μ N), |Σtᵢ| / (μ Σnᵢ) of the friction forces alone, and the tilt.

    T and N are the resultants of all contact forces along and across the plate; nᵢ and tᵢ are the normal force and the
    friction of contact point i, evaluated anew from the probe's side. The tilt is the resultant of all normal forces
    along the plate, relative to μ N.
    """
    ratio, friction, tilt = [], [], []
    for step in range(2, len(watched.states)):
        total = watched.nodal_forces(step).sum(axis=0)
        limit = MU * -total[1]
        ratio.append(np.hypot(total[0], total[2]) / limit)
        points = watched.contact_points(step)
        friction.append(np.linalg.norm(points.friction.sum(axis=0)) / (MU * points.size.sum()))
        push = points.push.sum(axis=0)
        tilt.append(np.hypot(push[0], push[2]) / limit)
    return np.array(ratio), np.array(friction), np.array(tilt)


def node_ratio(watched: Watched) -> float:
    """Largest |t| / (μ n) of the recorded force on any node, along and across the plane, at any increment."""
    forces = np.concatenate([watched.nodal_forces(step) for step in range(2, len(watched.states))])
    forces = forces[np.abs(forces).max(axis=1) > 0.0]
    return float((np.hypot(forces[:, 0], forces[:, 2]) / (MU * -forces[:, 1])).max())


def run(folder: Path) -> Section:
    """The check."""
    watched, sampled = drag(PLANE, 1000.0), drag(PLATE, 15.0)
    mesh = watched.system.mesh
    ratio, _, tilt = resultants(watched)
    own_ratio, own_friction, own_tilt = resultants(sampled)
    slide = np.concatenate([[0.0], ALONG])
    top = mesh.points[:, 1] > 15.0 - 1e-9
    moved = np.array([state.points[top, 0].mean() for state in watched.states[2:]])
    slip = slide - (moved - moved[0])  # of the plate over the block's top, on average
    # A node that slides carries |t| = μ n, so that rounding decides on which side of it a figure lies.
    rounding = 1e-11
    results = [
        Result.at_most("friction, largest |T| / (μ N) at any increment", float(ratio.max()), 1.0),
        Result.within("friction, |T| / (μ N) while sliding", float(ratio[-1]), 0.99, 1.01),
        Result.at_most(
            "friction, slip while |T| < μ N, relative to the displacement", float(abs(slip[1] / slide[1])), 0.05,
        ),
        Result.at_most("friction, |t| / (μ n) − 1 at any node and increment", node_ratio(watched) - 1.0, rounding),
        Result("friction, increments that converged", float(watched.simulation.converged.mean()), "= 1",
               bool(watched.simulation.converged.all() and sampled.simulation.converged.all())),
    ]
    rows = [("displacement [mm]", "plane: \\|T\\| / (μ N)", "tilt", "plate: \\|T\\| / (μ N)", "friction alone", "tilt")]
    for k in range(1, len(slide)):
        rows.append((
            f"{slide[k]:.2f}", f"{ratio[k]:.6f}", f"{tilt[k]:.1e}", f"{own_ratio[k]:.6f}", f"{own_friction[k]:.6f}",
            f"{own_tilt[k]:.1e}",
        ))

    def draw(axes):  # type: ignore[no-untyped-def]
        axes.plot(slide, ratio, "o-", markersize=3, label="plane, |T| / (μ N)")
        axes.plot(slide, own_ratio, "x", markersize=4, label="plate with contact points, |T| / (μ N)")
        axes.plot(slide, slip / DRAG, "s-", markersize=3, label="slip / largest displacement")
        axes.axhline(1.0, color="grey", linewidth=0.8, linestyle="--")
        axes.set(xlabel="displacement [mm]")
        axes.legend(frameon=False, fontsize=8)

    return Section(
        "Friction",
        f"A block is pressed by {PRESS:g} mm and the presser is then moved along it in steps of {INCREMENT:g} mm; "
        f"μ = {MU:g}. The block shears under the sticking presser until |T| = μ N, and then the presser slides. T and "
        "N are the resultants along and across the presser. The law holds for them where all normals are parallel: the "
        "presser is a *plane*, one triangle larger than the block, which touches the block's nodes. The same with a "
        "*plate* that has contact points of its own shows what a sampled probe adds. There the sum of the friction "
        "forces obeys the law, column *friction alone*. The resultant of all contact forces "
        f"may exceed it all the same, here by {100.0 * max(own_ratio.max() - 1.0, 0.0):.2g} % at most: a contact point "
        "that stands over a triangle beside an edge is within the gap of the neighbouring triangle, too, and that "
        "pair's normal force leans towards the edge. The column *tilt* is the resultant of all normal forces along "
        "the presser, relative to μ N; it accounts for the excess.",
        tuple(results), picture(folder, "friction", draw), tuple(rows),
    )
