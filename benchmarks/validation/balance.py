"""Equilibrium of each rigid body, of the probe and of the whole."""

from pathlib import Path

import numpy as np

from benchmarks.validation.blocks import two_bones
from benchmarks.validation.result import Result, Section, picture
from benchmarks.validation.watched import Watched, watch
from mixpinn.fem import Scene, SolverConfig, linear_probe
from mixpinn.records import ProbePath


def imbalances(watched: Watched, step: int) -> dict[str, float]:
    """Errors of the balances at a step, relative to the contact force, moments by the arm of 30 mm."""
    mesh, state = watched.system.mesh, watched.states[step]
    contact = watched.nodal_forces(step)
    internal = watched.system.gradient(state)
    push = contact.sum(axis=0)
    scale, arm = float(np.linalg.norm(push)), 30.0
    wrench = watched.system.part_wrench(internal - contact, state)
    probe = watched.simulation.probe_wrench[step]
    tip = watched.simulation.path.translations[step]
    moment = np.cross(state.points - tip, contact).sum(axis=0)
    free = (mesh.part == 0) & ~mesh.fixed
    return {
        "net force on a rigid body": float(np.linalg.norm(wrench[:, :3], axis=1).max() / scale),
        "net moment on a rigid body": float(np.linalg.norm(wrench[:, 3:], axis=1).max() / (scale * arm)),
        "net force on a soft node": float(np.linalg.norm((internal - contact)[free], axis=1).max() / scale),
        "probe's force against the sum of contact forces": float(np.linalg.norm(probe[:3] + push) / scale),
        "probe's moment against that of the contact forces":
            float(np.linalg.norm(probe[3:] + moment) / (scale * arm)),
        "reaction of the fixed nodes against the probe's force":
            float(np.linalg.norm(internal[mesh.fixed].sum(axis=0) + push) / scale),
    }


def run(folder: Path) -> Section:
    """The check: a probe pressed obliquely, then turned, on a block with two bones."""
    mesh = two_bones()
    down = np.concatenate([[32.5], 31.5 - np.arange(5.0)])
    places = np.column_stack([np.linspace(26.0, 29.0, len(down)), down, np.full(len(down), 15.0)])
    path = ProbePath(places, np.tile(np.eye(3), (len(down), 1, 1)), np.maximum(32.0 - down, 0.0))
    probe = linear_probe(length=30.0, width=12.0, height=20.0, radius=4.0)
    scene = Scene(mesh, probe, solver=SolverConfig(tolerance=1e-7))
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
        axes.legend(frameon=False, fontsize=6)

    return Section(
        "Equilibrium of rigid bodies and probe",
        "A probe is pressed obliquely on a block with two rigid bodies, friction 1. Forces are relative to the contact "
        "force, moments to the contact force at an arm of 30 mm. The solver's tolerance is tightened to 1e-7 here.",
        tuple(results), picture(folder, "balance", draw, size=(5.2, 3.4)),
    )
