"""Ten-node cells: patch test, orders, another code, nearly incompressible blocks, Hertz."""

from pathlib import Path

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray
from mixpinn.fem import ContactConfig, ElasticSystem, LinearElastic, Material, PoseSimulator, Scene, default_solver
from mixpinn.records import ProbePath, TissueMesh
from validation.blocks import block, labelled
from validation.closed_form import LAWS
from validation.contact import hertz
from validation.linear_elasticity import manufactured_error, order_of_convergence
from validation.newton import equilibrium
from validation.result import Result, Section, picture
from validation.scikit_oracle import oracle_difference

BEAM, PAD = (8.0, 2.0, 2.0), (40.0, 20.0, 40.0)
"""Sizes of the block in bending and of the block under the indenter [mm]."""
RATIOS = (0.45, 0.495)


def outer_nodes(mesh: TissueMesh) -> BoolArray:
    """Nodes on the faces of the bounding box, midpoints included."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    return ((mesh.node_points < low + 1e-9) | (mesh.node_points > high - 1e-9)).any(axis=1)


def patch_error(material: Material) -> float:
    """Largest error of an affine field imposed on the faces of a shaken cube, relative to the largest displacement."""
    mesh = block((3, 3, 3), shake=0.25, rng=np.random.default_rng(1)).with_order(2)
    system = ElasticSystem(mesh, [material])
    exact = mesh.node_points @ np.array([[0.15, 0.1, -0.05], [0.02, -0.1, 0.08], [0.12, 0.0, 0.05]]).T
    held = np.repeat(outer_nodes(mesh), 3)
    found = equilibrium(system, system.rest_state(), held=held, shift=np.where(held, exact.ravel(), 0.0))
    return float(np.abs(found.state.points - mesh.node_points - exact).max() / np.abs(exact).max())


def bending(n: int, order: int, poisson: float) -> float:
    """Mean deflection of the loaded end of a clamped block of n cells across [mm], E = 1 N/mm², 0.001 N in all."""
    mesh = block((4 * n, n, n), size=BEAM)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9).with_order(order)
    system = ElasticSystem(mesh, [LinearElastic.from_young(1.0, poisson)])
    faces = mesh.skin_node_faces[(mesh.points[mesh.skin_faces][:, :, 0] > BEAM[0] - 1e-9).all(axis=1)]
    share = np.array([1.0, 1.0, 1.0] if order == 1 else [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) / 3.0
    weight = np.zeros(mesh.n_nodes)  # of a uniform shear; all faces are of one size
    np.add.at(weight, faces, np.tile(share, (len(faces), 1)) / len(faces))
    load = np.outer(weight, [0.0, -1e-3, 0.0])
    found = equilibrium(system, system.rest_state(), load=load, tolerance=1e-10, linear=default_solver(1))
    return float(((found.state.points - mesh.node_points)[:, 1] * weight).sum())


def indenter(n: int, order: int, poisson: float) -> float:
    """Force of a rigid cap of 160 mm radius pressed 1 mm into a block with n cells over its height [N], no friction."""
    mesh = block((2 * n, n, 2 * n), size=PAD)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 1] < 1e-9).with_order(order)
    spacing = PAD[1] / (4.0 * n)
    config = ContactConfig(
        gap=0.5, alarm=1.0, friction=0.0, stiffness=20.0 * spacing**2, smoothing=1e-3, spacing=spacing,
    )
    tool = hertz.cap(16.0, 1.0, radius=160.0)
    scene = Scene(mesh, tool, (LinearElastic.from_young(25.4e-3, poisson),), config)
    depths = np.array([-0.1, 1.0])
    path = ProbePath(
        np.array([0.5 * PAD[0], PAD[1] + 0.5, 0.5 * PAD[2]]) - depths[:, None] * [0.0, 1.0, 0.0],
        np.tile(np.eye(3), (2, 1, 1)), depths,
    )
    found = PoseSimulator(scene).run(path)
    return float(found.probe_wrench[1, 1]) if found.converged.all() else float("nan")


def converged(values: FloatArray) -> float:
    """Value that a sequence on meshes of half the width each tends to, its last step taken as order 2."""
    return float(values[-1] + (values[-1] - values[-2]) / 3.0)


def nearly_incompressible() -> tuple[list[Result], list[tuple[str, ...]]]:
    """Both blocks at both ratios: each element against the converged value of the quadratic one."""
    results, rows = [], [("block", "ν", "linear", "linear, halved", "quadratic", "quadratic, halved")]
    for name, measure, n in (("bending", bending, 3), ("indenter", indenter, 3)):
        for ratio in RATIOS:
            linear = [measure(size, 1, ratio) for size in (n, 2 * n)]
            quadratic = np.array([measure(size, 2, ratio) for size in (n, 2 * n)])
            value = converged(quadratic)
            error = float(abs(quadratic[-1] / value - 1.0))
            results.append(Result.at_most(f"{name}, ν = {ratio:g}, quadratic against its converged value", error, 0.01))
            rows.append((name, f"{ratio:g}", *(f"{100 * (v / value - 1.0):+.2f} %" for v in (*linear, *quadratic))))
    return results, rows


def run(folder: Path) -> Section:
    """The checks."""
    results = [
        Result.at_most(f"affine patch test, quadratic, {type(law).__name__}", patch_error(law), 1e-10) for law in LAWS
    ]
    difference = oracle_difference((6, 4, 4), order=2, linear=default_solver(1))
    results.append(Result.at_most("quadratic against scikit-fem, relative difference", difference, 1e-8))
    sizes = np.array([2, 4, 6, 8])
    errors = np.array([manufactured_error(int(n), order=2, tolerance=1e-9) for n in sizes])
    order = order_of_convergence(sizes, errors)
    results.append(Result.within("order of convergence in L2, quadratic, manufactured solution", order, 2.8, 3.2))
    blocks, rows = nearly_incompressible()
    found = hertz.indent(1.5, order=2)
    force = float(np.abs(found.force[-1] / hertz.exact_force()[-1] - 1.0))
    results += [*blocks, Result.at_most("Hertz, quadratic, 1.5 cells per contact radius, force error", force, 0.02)]

    def draw(axes):  # type: ignore[no-untyped-def]
        axes.loglog(1.0 / sizes, errors, "o-", label="error in L2")
        axes.loglog(1.0 / sizes, errors[-1] * (sizes[-1] / sizes) ** 3, "k--", linewidth=0.8, label="order 3")
        axes.set(xlabel="mesh width h", ylabel="error of the displacement")
        axes.legend(frameon=False, fontsize=8)

    return Section(
        "Quadratic tetrahedra",
        "Ten-node cells under the checks of the linear ones, and where linear ones lock: a clamped block of "
        f"{BEAM[0]:g} × {BEAM[1]:g} × {BEAM[2]:g} mm, loaded across at its end (3 and 6 cells across), and a block of "
        f"{PAD[0]:g} × {PAD[1]:g} × {PAD[2]:g} mm under a rigid cap of 160 mm radius pressed 1 mm deep (3 and 6 "
        "cells over its height). The table gives deflection and force against the value that the quadratic cells tend "
        "to, extrapolated with order 2.",
        tuple(results), picture(folder, "quadratic", draw), tuple(rows),
    )
