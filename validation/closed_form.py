"""Patch test, uniaxial stretch and simple shear against closed forms."""

from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import ElasticSystem, LinearElastic, Material, StableNeoHookean, StableNeoHookeanLog
from validation.blocks import block, surface_nodes
from validation.newton import equilibrium
from validation.result import Result, Section, picture

SOFT = StableNeoHookean(mu=1.0, lam=4.0)
LAWS: tuple[Material, ...] = (SOFT, StableNeoHookeanLog(mu=1.0, lam=4.0), LinearElastic(mu=1.0, lam=4.0))


def patch_error(material: Material) -> float:
    """Largest error of an affine field imposed on the faces of a shaken cube, relative to the largest displacement."""
    mesh = block((4, 4, 4), shake=0.25, rng=np.random.default_rng(1))
    system = ElasticSystem(mesh, [material])
    affine = np.array([[0.15, 0.1, -0.05], [0.02, -0.1, 0.08], [0.12, 0.0, 0.05]])
    exact = mesh.points @ affine.T
    held = np.repeat(surface_nodes(mesh), 3)
    found = equilibrium(system, system.rest_state(), held=held, shift=np.where(held, exact.ravel(), 0.0))
    return float(np.abs(found.state.points - mesh.points - exact).max() / np.abs(exact).max())


def uniaxial_force(stretch: float) -> float:
    """Axial force per rest area of the stretched block, sides free [N/mm²], from the finite elements."""
    mesh = block((3, 3, 3), shake=0.2, rng=np.random.default_rng(2))
    system = ElasticSystem(mesh, [SOFT])
    x = mesh.points
    # Faces x = 0 and x = 1 are held in x alone, y = 0 in y, z = 0 in z: the lateral faces are free to contract.
    held = np.stack([(x[:, 0] < 1e-9) | (x[:, 0] > 1.0 - 1e-9), x[:, 1] < 1e-9, x[:, 2] < 1e-9], axis=1)
    state, done = system.rest_state(), 1.0
    for target in np.linspace(1.0, stretch, 6)[1:]:
        move = np.zeros_like(x)
        move[:, 0] = (target - done) * x[:, 0]
        shift = np.where(held, move, 0.0).ravel()
        state = equilibrium(system, state, held=held.ravel(), shift=shift, tolerance=1e-11).state
        done = target
    return float(system.gradient(state)[x[:, 0] > 1.0 - 1e-9, 0].sum())


def uniaxial_closed_form(stretch: float) -> float:
    """P₁₁ of diag(a, b, b) with b from P₂₂ = μ b + (λ + μ)(J − α) a b = 0, J = a b²."""
    bulk = SOFT.lam + SOFT.mu
    alpha = 1.0 + SOFT.mu / bulk

    def lateral(b: float) -> float:
        return SOFT.mu + bulk * (stretch * b * b - alpha) * stretch

    b = float(brentq(lateral, 1e-6, 3.0))
    return SOFT.mu * stretch + bulk * (stretch * b * b - alpha) * b * b


def shear_stress(shear: float) -> float:
    """Shear force per area on the inner nodes of the top of a cube in simple shear [N/mm²]."""
    mesh = block((3, 3, 3), shake=0.2, rng=np.random.default_rng(3))
    system = ElasticSystem(mesh, [SOFT])
    held = np.repeat(surface_nodes(mesh), 3)
    shift = np.zeros_like(mesh.points)
    shift[:, 0] = shear * mesh.points[:, 1]
    found = equilibrium(system, system.rest_state(), held=held, shift=np.where(held, shift.ravel(), 0.0))
    # The stress is uniform, so that its forces on the top face add up to P₁₂ over the inner nodes' share of the area.
    top = mesh.points[:, 1] > 1.0 - 1e-9
    inner = top & (np.abs(mesh.points[:, [0, 2]] - 0.5) < 0.4).all(axis=1)
    share = _face_share(mesh.points, mesh.skin_faces, top)[inner].sum()
    return float(system.gradient(found.state)[inner, 0].sum() / share)


def _face_share(points: FloatArray, faces: np.ndarray, chosen: np.ndarray) -> FloatArray:
    """A third of the area of the faces whose nodes are all `chosen`, gathered at each node."""
    flat = faces[chosen[faces].all(axis=1)]
    a, b, c = np.moveaxis(points[flat], 1, 0)
    share = np.zeros(len(points))
    np.add.at(share, flat, np.linalg.norm(np.cross(b - a, c - a), axis=1)[:, None] / 6.0)
    return share


def run(folder: Path) -> Section:
    """The checks."""
    results = [Result.at_most(f"affine patch test, {type(law).__name__}", patch_error(law), 1e-10) for law in LAWS]
    stretches = np.array([0.5, 0.6, 0.75, 0.9, 1.25, 1.5, 1.75, 2.0])
    exact = np.array([uniaxial_closed_form(stretch) for stretch in stretches])
    found = np.array([uniaxial_force(stretch) for stretch in stretches])
    results.append(Result.at_most("uniaxial stretch 0.5–2.0, relative error", np.abs(found / exact - 1.0).max(), 1e-3))
    shears = np.array([0.1, 0.25, 0.5, 0.75, 1.0])
    stresses = np.array([shear_stress(shear) for shear in shears])
    # J = 1 in simple shear, hence W = μ/2 γ² and the stress μ γ.
    error = np.abs(stresses / (SOFT.mu * shears) - 1.0).max()
    results.append(Result.at_most("simple shear, relative error", error, 1e-3))

    def draw(axes):  # type: ignore[no-untyped-def]
        line = np.linspace(0.5, 2.0, 60)
        axes.plot(line, [uniaxial_closed_form(value) for value in line], label="uniaxial, closed form")
        axes.plot(stretches, found, "o", label="uniaxial, finite elements")
        axes.plot(1.0 + line[line <= 1.0], SOFT.mu * line[line <= 1.0], label="shear, closed form")
        axes.plot(1.0 + shears, stresses, "s", label="shear, finite elements")
        axes.set(xlabel="stretch, or 1 + shear", ylabel="first Piola-Kirchhoff stress / μ")
        axes.legend(frameon=False, fontsize=8)

    return Section(
        "Patch test, uniaxial stretch, simple shear",
        "Affine displacements on all faces of a cube with shaken inner nodes must appear inside, too. The uniaxial "
        "block is free at its sides: its lateral stretch solves P₂₂ = 0. In simple shear the stress is μ γ.",
        tuple(results), picture(folder, "closed_form", draw),
    )
