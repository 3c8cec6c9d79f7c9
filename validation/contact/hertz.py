"""Hertz: a rigid sphere pressed into an elastic block."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import ContactConfig, LinearElastic, Scene
from mixpinn.records import Probe, ProbePath
from validation.blocks import grid_block, labelled
from validation.contact.watched import watch
from validation.result import Result, Section, picture

YOUNG, POISSON = 25.4e-3, 0.3
GAP = 0.25
RADIUS = 200.0
DEPTHS = np.array([0.09, 0.18])
EXTENT = 200.0
"""Half width and height of the block in contact radii at the largest depth."""


@dataclass(frozen=True)
class Indentation:
    """Force [N] and contact radius [mm] at each depth, and the mesh width under the contact [mm]."""

    width: float
    nodes: int
    force: FloatArray
    radius: FloatArray


def exact_radius() -> FloatArray:
    """a = √(R δ) [mm]; contact acts at the gap, so that the sphere's radius is its own and the gap."""
    return np.sqrt((RADIUS + GAP) * DEPTHS)


def exact_force() -> FloatArray:
    """F = 4/3 E/(1 − ν²) √R δ^(3/2) [N] (K. L. Johnson, Contact Mechanics, 1985, section 4.2)."""
    return 4.0 / 3.0 * YOUNG / (1.0 - POISSON**2) * np.sqrt(RADIUS + GAP) * DEPTHS**1.5


def graded(fine: float, inner: float, outer: float, *, growth: float = 1.15, largest: float = 1.8) -> FloatArray:
    """Coordinates from 0: steps of `fine` up to `inner`, then steps that grow ever faster up to `outer` [mm].

    Each step beyond `inner` is `growth` times the one before, and growth itself grows up to `largest`.
    """
    places = list(np.linspace(0.0, inner, round(inner / fine) + 1))
    step = fine
    while places[-1] < outer:
        step *= growth
        growth = min(growth + 0.04, largest)
        places.append(places[-1] + step)
    places[-1] = max(outer, places[-2] + fine)
    return np.array(places)


def cap(extent: float, spacing: float, *, radius: float = RADIUS) -> Probe:
    """The lowest part of a sphere over a square of half width `extent`, triangulated with steps of `spacing` [mm]."""
    n = 2 * int(np.ceil(extent / spacing))
    line = np.linspace(-extent, extent, n + 1)
    x, z = np.meshgrid(line, line, indexing="ij")
    height = radius - np.sqrt(radius**2 - x**2 - z**2)
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Probe(np.column_stack([x.ravel(), height.ravel(), z.ravel()]), triangles, "spherical cap")


def indent(per_radius: float, *, order: int = 1) -> Indentation:
    """Press the sphere with `per_radius` cells of that order to the contact radius at the largest depth."""
    a = float(exact_radius()[-1])
    fine = a / per_radius
    # Quadratic cells follow the decay from larger steps.
    growth, largest = (1.15, 1.8) if order == 1 else (1.6, 2.4)
    half = graded(fine, 1.35 * a, EXTENT * a, growth=growth, largest=largest)
    across = np.concatenate([-half[:0:-1], half])
    mesh = grid_block(across, -half[::-1], across)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    outer = (mesh.points < low + 1e-9).any(axis=1) | (mesh.points[:, [0, 2]] > high[[0, 2]] - 1e-9).any(axis=1)
    mesh = labelled(mesh.points, mesh.cells, fixed=outer).with_order(order)
    scene = Scene(
        mesh, cap(1.3 * a, 0.5 * fine), (LinearElastic.from_young(YOUNG, POISSON),),
        ContactConfig(gap=GAP, alarm=2.0 * GAP, friction=0.0, stiffness=20.0, smoothing=2e-4, spacing=fine / order**2),
    )
    heights = np.concatenate([[GAP + 0.02], GAP - DEPTHS])
    path = ProbePath(
        heights[:, None] * [0.0, 1.0, 0.0], np.tile(np.eye(3), (len(heights), 1, 1)), np.concatenate([[0.0], DEPTHS]),
    )
    watched = watch(scene, path)
    assert watched.simulation.converged.all()
    force, radius = [], []
    for step in range(1, len(heights)):
        nodal = watched.nodal_forces(step)
        push = -nodal[:, 1]
        distance = (watched.states[step].points[:, [0, 2]] ** 2).sum(axis=1)
        force.append(push.sum())
        # Under p = p₀ √(1 − r²/a²) the mean of r², weighted by the pressure, is 2/5 a².
        radius.append(np.sqrt(2.5 * (push * distance).sum() / push.sum()))
    return Indentation(fine, mesh.n_nodes, np.array(force), np.array(radius))


def run(folder: Path) -> Section:
    """The check, on three meshes."""
    runs = [indent(per_radius) for per_radius in (2.0, 3.0, 6.0)]
    force, radius = exact_force(), exact_radius()
    force_errors = [float(np.abs(run.force[-1] / force[-1] - 1.0)) for run in runs]
    radius_errors = [float(np.abs(run.radius[-1] / radius[-1] - 1.0)) for run in runs]
    results = [
        Result.at_most("Hertz, force on the finest mesh, relative error", force_errors[-1], 0.05),
        Result.at_most("Hertz, contact radius on the finest mesh, relative error", radius_errors[-1], 0.05),
        Result.at_most(
            "Hertz, force error of a mesh relative to the next coarser one",
            max(b / a for a, b in pairwise(force_errors)), 1.0,
        ),
    ]
    rows = [("cells per contact radius", "nodes", "force error", "radius error")]
    for run, f, r in zip(runs, force_errors, radius_errors, strict=True):
        rows.append((f"{radius[-1] / run.width:.1f}", f"{run.nodes}", f"{100 * f:.2f} %", f"{100 * r:.2f} %"))

    def draw(axes):  # type: ignore[no-untyped-def]
        line = np.linspace(0.0, DEPTHS[-1], 60)
        axes.plot(line, force[-1] * (line / DEPTHS[-1]) ** 1.5, "k", linewidth=0.8, label="Hertz")
        for run in runs:
            axes.plot(DEPTHS, run.force, "o", markersize=4, label=f"h = a / {radius[-1] / run.width:.0f}")
        axes.set(xlabel="approach δ [mm]", ylabel="force [N]")
        axes.legend(frameon=False, fontsize=8)

    return Section(
        "Hertz",
        f"A rigid sphere of {RADIUS:g} mm, frictionless, on a block of E = {YOUNG * 1e3:g} kPa and ν = {POISSON:g} "
        f"that reaches {EXTENT:g} contact radii in every direction and is held at its outer faces. Contact acts at a "
        f"gap of {GAP:g} mm, so that the effective radius is {RADIUS + GAP:g} mm. The radius follows from the second "
        "moment of the contact forces, Σ F r² / Σ F = 2/5 a². The sphere is large against the contact (a / R = 0.03), "
        "since the skin's motion towards the axis, which Hertz neglects, raises the force by a share of the order "
        "a / R.",
        tuple(results), picture(folder, "hertz", draw), tuple(rows),
    )
