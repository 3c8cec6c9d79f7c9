"""Equilibrium of each rigid body, of the probe and of the whole."""

from pathlib import Path

import numpy as np

from mixpinn.fem import PAPER_TISSUE, Scene, SolverConfig
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.records import ProbePath
from validation.blocks import two_bones
from validation.contact.watched import Watched, watch
from validation.result import Result, Section, picture

ARM = 30.0
"""By which moments are made comparable with forces [mm]."""


def imbalances(watched: Watched, step: int) -> dict[str, float]:
    """Errors of the balances at a step, relative to the contact force, moments to the contact force at `ARM`."""
    mesh, state = watched.system.mesh, watched.states[step]
    contact = watched.nodal_forces(step)
    internal = watched.system.gradient(state)
    scale = float(np.linalg.norm(contact.sum(axis=0)))
    parts = watched.system.part_wrench(internal - contact, state)
    arms = state.points - watched.simulation.path.translations[step]  # from the probe's tip
    free = (mesh.part == 0) & ~mesh.fixed
    # The same wrench of the probe on the body by three routes.
    recorded = -watched.simulation.probe_wrench[step]
    from_points = -watched.contact_points(step).wrench_on_probe()
    held = internal * mesh.fixed[:, None]
    reaction = -np.concatenate([held.sum(axis=0), np.cross(arms, held).sum(axis=0)])

    def apart(wrench: np.ndarray, first: slice) -> float:
        return float(np.linalg.norm((wrench - recorded)[first]) / scale)

    force, moment = slice(0, 3), slice(3, 6)
    return {
        "net force on a rigid body": float(np.linalg.norm(parts[:, :3], axis=1).max() / scale),
        "net moment on a rigid body": float(np.linalg.norm(parts[:, 3:], axis=1).max() / (scale * ARM)),
        "net force on a soft node": float(np.linalg.norm((internal - contact)[free], axis=1).max() / scale),
        "probe's force, summed over its contact points": apart(from_points, force),
        "probe's moment, summed over its contact points": apart(from_points, moment) / ARM,
        "probe's force, from the reaction of the fixed nodes": apart(reaction, force),
        "probe's moment, from the reaction of the fixed nodes": apart(reaction, moment) / ARM,
    }


def run(folder: Path) -> Section:
    """The check: a probe pressed obliquely on a block with two bones."""
    mesh = two_bones()
    down = np.concatenate([[32.5], 31.5 - np.arange(5.0)])
    places = np.column_stack([np.linspace(26.0, 29.0, len(down)), down, np.full(len(down), 15.0)])
    path = ProbePath(places, np.tile(np.eye(3), (len(down), 1, 1)), np.maximum(32.0 - down, 0.0))
    probe = linear_probe(length=30.0, width=12.0, height=20.0, radius=4.0)
    scene = Scene(mesh, probe, (PAPER_TISSUE,), solver=SolverConfig(tolerance=1e-7))
    watched = watch(scene, path)
    steps = [step for step in range(len(watched.states)) if np.abs(watched.nodal_forces(step)).max() > 0.0]
    found = [imbalances(watched, step) for step in steps]
    results = [Result.at_most(f"balance, {name}", max(entry[name] for entry in found), 1e-6) for name in found[0]]

    def draw(axes):  # type: ignore[no-untyped-def]
        for name in found[0]:
            values = [max(entry[name], 1e-18) for entry in found]
            axes.semilogy(path.depths[steps], values, "o-", markersize=3, label=name)
        axes.axhline(1e-6, color="grey", linewidth=0.8, linestyle="--")
        axes.set(xlabel="depth [mm]", ylabel="relative imbalance")
        axes.legend(frameon=False, fontsize=6, loc="center left", bbox_to_anchor=(1.0, 0.5))

    return Section(
        "Equilibrium of rigid bodies and probe",
        "A probe is pressed obliquely on a block with two rigid bodies, friction 1. Forces are relative to the contact "
        "force, moments to the contact force at an arm of 30 mm. The solver's tolerance is tightened to 1e-7 here. The "
        "probe's wrench as it is recorded is the sum of the forces on the nodes. It is compared with contact evaluated "
        "once more in plain NumPy and summed over the contact points of the probe, and with the reaction of the nodes "
        "that are held, which knows of elasticity alone.",
        tuple(results), picture(folder, "balance", draw, size=(7.6, 3.4)),
    )
