"""Energy, stress and tangent of each material against finite differences; objectivity; rest under rigid motion."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import ElasticSystem, LinearElastic, Material, StableNeoHookean, StableNeoHookeanLog
from validation.blocks import labelled, two_bones
from validation.result import Result, Section, picture

MATERIALS: dict[str, Material] = {
    "Stable Neo-Hookean": StableNeoHookean(mu=8.758621e-3, lam=84.666667e-3),
    "Stable Neo-Hookean with logarithm": StableNeoHookeanLog(mu=8.758621e-3, lam=84.666667e-3),
    "linear elastic": LinearElastic(mu=8.758621e-3, lam=84.666667e-3),
}
SCALE = 84.666667e-3
"""Stress that errors of stress vanishing at rest are measured against [N/mm²]."""


def difference_error(material: Material, deformation: FloatArray, directions: FloatArray, h: float) -> float:
    """Largest relative error of stress and tangent along `directions` against central differences of step `h`."""
    ahead, behind = deformation + h * directions, deformation - h * directions
    stress, tangent = material.gradient(deformation), material.hessian(deformation)
    slope = (material.energy(ahead) - material.energy(behind)) / (2.0 * h)
    change = (material.gradient(ahead) - material.gradient(behind)) / (2.0 * h)
    slope_error = np.abs(slope - np.einsum("mij,mij->m", stress, directions)).max() / np.abs(slope).max()
    expected = np.einsum("mab,mb->ma", tangent, directions.reshape(-1, 9))
    change_error = np.abs(change.reshape(-1, 9) - expected).max() / np.abs(change).max()
    return float(max(slope_error, change_error))


def objectivity_error(material: Material, deformation: FloatArray, turns: FloatArray) -> float:
    """Largest relative error of Ψ(R F) = Ψ(F) and P(R F) = R P(F)."""
    turned = turns @ deformation
    stress = turns @ material.gradient(deformation)
    energy = material.energy(deformation)
    return float(max(
        np.abs(material.gradient(turned) - stress).max() / np.abs(stress).max(),
        np.abs(material.energy(turned) - energy).max() / np.abs(energy).max(),
    ))


def rigid_motion_force(material: Material, turn: FloatArray, shift: FloatArray) -> float:
    """Largest nodal force of a mesh with bones that moves as a whole, relative to a stress λ on a face of the block."""
    mesh = two_bones()
    mesh = labelled(mesh.points, mesh.cells, part=mesh.part)
    system = ElasticSystem(mesh, [material])
    centroids = np.array([mesh.points[mesh.part_nodes(k + 1)].mean(axis=0) for k in range(mesh.n_parts)])
    state = system.place(
        mesh.points @ turn.T + shift, np.tile(turn, (mesh.n_parts, 1, 1)), centroids @ turn.T + shift - centroids,
    )
    return float(np.abs(system.gradient(state)).max() / (SCALE * 30.0**2))


def run(folder: Path) -> Section:
    """The checks of the materials."""
    rng = np.random.default_rng(0)
    deformation = np.eye(3) + 0.3 * rng.normal(size=(200, 3, 3))
    turns = Rotation.random(200, random_state=1).as_matrix()
    directions = rng.normal(size=(200, 3, 3))
    steps = np.logspace(-2, -9, 15)
    curves = {
        name: [difference_error(law, deformation, directions, h) for h in steps] for name, law in MATERIALS.items()
    }
    results = [
        Result.at_most(f"stress and tangent by finite differences, {name}", min(curve), 1e-6)
        for name, curve in curves.items()
    ]
    objective = {name: law for name, law in MATERIALS.items() if not isinstance(law, LinearElastic)}
    shift = np.array([40.0, -25.0, 60.0])
    for name, law in objective.items():
        results.append(Result.at_most(f"objectivity, {name}", objectivity_error(law, deformation, turns), 1e-12))
    for name, law in objective.items():
        force = max(rigid_motion_force(law, turn, shift) for turn in turns[:5])
        results.append(Result.at_most(f"force under rigid motion, {name}", force, 1e-12))

    def draw(axes):  # type: ignore[no-untyped-def]
        for name, curve in curves.items():
            axes.loglog(steps, curve, ".-", label=name)
        axes.axhline(1e-6, color="grey", linewidth=0.8, linestyle="--")
        axes.set(xlabel="step of the difference", ylabel="relative error")
        axes.legend(frameon=False, fontsize=8)

    return Section(
        "Materials",
        "Stress P = ∂Ψ/∂F and tangent ∂P/∂F along random directions against central differences of energy and stress, "
        "at 200 random deformation gradients, some of them inverted. The error falls with the square of the step until "
        "rounding takes over; its smallest value counts. Objectivity: Ψ(RF) = Ψ(F), P(RF) = R P(F). "
        "Rigid motion: a block with two rigid parts "
        "is turned by up to π and shifted; nodal forces are relative to λ on a face of the block. (Linear elasticity "
        "is not objective by nature.)",
        tuple(results), picture(folder, "material", draw),
    )
