"""Layers: a block of skin, fat and muscle against its closed form, and an indentation of two layers by scikit-fem."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import skfem

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.fem import ElasticSystem, LinearElastic, StableNeoHookean, default_solver, solve_imposed
from mixpinn.records import TissueMesh
from validation.blocks import grid_block
from validation.newton import equilibrium
from validation.result import Result, Section, picture
from validation.scikit_oracle import scikit_stiffness

LAYERS = (
    ("muscle", 20.0, StableNeoHookean.from_young(62.2e-3, 0.45)),
    ("fat", 12.0, StableNeoHookean.from_young(26.1e-3, 0.40)),
    ("skin", 4.0, StableNeoHookean.from_young(0.6, 0.30)),
)
"""Name, thickness [mm] and material from below; Poisson's ratio differs from layer to layer."""
SIDE = 24.0


def layered(materials: int, heights: FloatArray, mesh: TissueMesh) -> TissueMesh:
    """`mesh` with its cells labelled by the layer that their centroid lies in."""
    middle = mesh.points[mesh.cells].mean(axis=1)[:, 1]
    tissue = np.searchsorted(heights, middle).astype(np.int16)
    return replace(mesh, tissue=tissue, tissue_names=tuple(f"layer {i}" for i in range(materials)))


def stack() -> tuple[TissueMesh, FloatArray]:
    """The block of `LAYERS`, fixed below, and the heights of its interfaces [mm]."""
    heights = np.cumsum([thickness for _, thickness, _ in LAYERS])
    y = np.unique(np.concatenate([np.linspace(0.0, 20.0, 5), np.linspace(20.0, 32.0, 4), np.linspace(32.0, 36.0, 3)]))
    ticks = np.linspace(0.0, SIDE, 5)
    mesh = layered(len(LAYERS), heights[:-1], grid_block(ticks, y, ticks))
    return replace(mesh, fixed=mesh.points[:, 1] < 1e-9), heights


def stack_error(way: str, order: int, strain: float = 0.1) -> float:
    """Force on the top against its closed form, relative: ``compression`` (confined) or ``shear`` by a mean strain.

    Stable Neo-Hookean, P = μ F + ((λ + μ)(J − 1) − μ) cof F. Confined, F = diag(1, J, 1) gives P_yy = (λ + 2μ)(J − 1);
    in simple shear by γ, P_xy = μ γ and P_yy = 0. Both are linear at any strain, so that the layers are springs in a
    row: force over area = Δ / Σ h_i / k_i with k_i = λ_i + 2 μ_i or μ_i.
    """
    mesh, heights = stack()
    mesh = mesh.with_order(order)
    system = ElasticSystem(mesh, [material for _, _, material in LAYERS])
    points = mesh.node_points
    unknown = system.node_dofs(np.arange(mesh.n_nodes))
    held, shift = np.zeros(system.n_dofs, dtype=bool), np.zeros(system.n_dofs)
    top = points[:, 1] > heights[-1] - 1e-9
    faces = [(points[:, axis] < 1e-9) | (points[:, axis] > SIDE - 1e-9) for axis in (0, 2)]
    closed = ((0, faces[0]), (2, faces[1])) if way == "compression" else ((1, faces[0]), (2, faces[1]))
    for axis, nodes in (*closed, (0, top), (1, top), (2, top)):
        rows = unknown[nodes, axis]
        held[rows[rows >= 0]] = True
    move, axis = (-strain * heights[-1], 1) if way == "compression" else (strain * heights[-1], 0)
    shift[unknown[top, axis]] = move
    found = equilibrium(system, system.rest_state(), held=held, shift=shift, tolerance=1e-10)
    force = float(system.gradient(found.state)[top, axis].sum())
    moduli = [material.lam + 2.0 * material.mu if way == "compression" else material.mu for _, _, material in LAYERS]
    springs = sum(thickness / modulus for (_, thickness, _), modulus in zip(LAYERS, moduli, strict=True))
    return abs(force / (SIDE**2 * move / springs) - 1.0)


def indentation_errors(order: int) -> tuple[float, float]:
    """Force and field of a disc pressed into two layers, against scikit-fem on the same cells, relative."""
    ticks = np.linspace(0.0, 40.0, 9)
    heights = np.array([0.0, 6.0, 12.0, 18.0, 21.0, 24.0, 27.0, 30.0])
    mesh = layered(2, np.array([18.0]), grid_block(ticks, heights, ticks))
    mesh = replace(mesh, fixed=mesh.points[:, 1] < 1e-9).with_order(order)
    materials = [LinearElastic.from_young(62.2e-3, 0.45), LinearElastic.from_young(26.1e-3, 0.40)]
    points = mesh.node_points
    disc = np.flatnonzero(
        (points[:, 1] > 30.0 - 1e-9) & (np.hypot(points[:, 0] - 20.0, points[:, 2] - 20.0) < 11.0)
    )
    push = np.tile([0.0, -1.0, 0.0], (len(disc), 1))
    found = solve_imposed(ElasticSystem(mesh, materials), [(disc, push)], linear=default_solver())
    field, force = found.displacement[0], found.gradient[0][disc, 1].sum()
    expected, reference = oracle(mesh, materials, disc, push)
    return abs(force / reference - 1.0), float(np.abs(field - expected).max() / np.abs(expected).max())


def oracle(
    mesh: TissueMesh, materials: Sequence[LinearElastic], nodes: IntArray, push: FloatArray,
) -> tuple[FloatArray, float]:
    """scikit-fem's displacement of every node of the mesh [mm] and the force on the pushed ones along y [N]."""
    stiffness, unknown = scikit_stiffness(mesh, materials)
    solution = np.zeros(unknown.size)
    solution[unknown[nodes]] = push
    held = np.concatenate([unknown[mesh.node_fixed].ravel(), unknown[nodes].ravel()])
    solution = skfem.solve(*skfem.condense(stiffness, np.zeros(unknown.size), x=solution, D=held))
    field: FloatArray = solution[unknown]
    return field, float((stiffness @ solution)[unknown[nodes, 1]].sum())


def run(folder: Path) -> Section:
    """The checks."""
    results, table = [], [("check", "linear cells", "quadratic cells")]
    for way in ("compression", "shear"):
        errors = [stack_error(way, order) for order in (1, 2)]
        name = "confined compression" if way == "compression" else "simple shear"
        results.append(Result.at_most(f"three layers, {name}, force against the closed form", max(errors), 1e-3))
        table.append((f"{name} by 10 %", f"{errors[0]:.1e}", f"{errors[1]:.1e}"))
    pressed = [indentation_errors(order) for order in (1, 2)]
    results += [
        Result.at_most("two layers, indentation, force against scikit-fem", max(force for force, _ in pressed), 1e-2),
        Result.at_most("two layers, indentation, field against scikit-fem", max(field for _, field in pressed), 1e-2),
    ]
    table += [
        ("indentation, force", f"{pressed[0][0]:.1e}", f"{pressed[1][0]:.1e}"),
        ("indentation, field", f"{pressed[0][1]:.1e}", f"{pressed[1][1]:.1e}"),
    ]

    def draw(axes):  # type: ignore[no-untyped-def]
        low = 0.0
        for name, thickness, material in LAYERS:
            strain = 0.1 * 36.0 / sum(h / (m.lam + 2 * m.mu) for _, h, m in LAYERS) / (material.lam + 2 * material.mu)
            axes.fill_between([0.0, strain], low, low + thickness, alpha=0.6, label=name)
            low += thickness
        axes.set(xlabel="strain at 10 % mean compression", ylabel="height [mm]")
        axes.legend(frameon=False, fontsize=8)

    return Section(
        "Layers",
        "A block of muscle, fat and skin (20, 12 and 4 mm; E = 62.2, 26.1 and 600 kPa; ν = 0.45, 0.40, 0.30) is "
        "compressed between closed walls and sheared by 10 %: springs in a row, exactly, at finite strain. A disc is "
        "pressed into 12 mm of fat on 18 mm of muscle, against scikit-fem on the same cells (linear elasticity).",
        tuple(results), picture(folder, "layers", draw), tuple(table),
    )
