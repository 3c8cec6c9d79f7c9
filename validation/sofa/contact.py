"""SOFA's static fields with our own contact: the probe's path replayed against SOFA's collision patch."""

from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.progress import track
from mixpinn.fem import PoseSimulator
from mixpinn.records import Simulation
from validation.result import Result, Section, picture
from validation.sofa.fields import (
    APPROACH,
    Recording,
    StaticField,
    data_folder,
    paper_folder,
    paper_mesh,
    sofa_scene,
)


def replayer(data: Path) -> tuple[PoseSimulator, FloatArray]:
    """A simulator of SOFA's scene on the paper's mesh, and the positions of the poses [mm], shape (p, 3)."""
    return PoseSimulator(sofa_scene(data, paper_mesh(data))), np.loadtxt(paper_folder(data) / "probe_positions.txt")


def simulate(simulator: PoseSimulator, field: StaticField, cache: Path) -> Simulation:
    """The pose's simulation, kept in `cache` under the scene's identity."""
    kept = cache / f"{field.name}-{simulator.scene.hash()[:16]}"
    if not kept.is_dir():
        cache.mkdir(parents=True, exist_ok=True)
        simulator.run(field.path).save(kept)
    return Simulation.load(kept)


def run(folder: Path, *, cache: Path) -> Section:
    """The check."""
    title = "SOFA's static fields, own contact"
    data = data_folder()
    names = (
        "SOFA static, mean difference relative to the mean displacement", "SOFA static, vertebra translation [mm]",
        "SOFA static, probe force, relative error",
    )
    bars = (0.05, 0.15, 0.05)
    if data is None:
        missing = tuple(Result(name, np.nan, f"≤ {bar}", False) for name, bar in zip(names, bars, strict=True))
        return Section(title, "Not run: the recorded fields are absent.", missing)
    simulator, positions = replayer(data)
    mesh = simulator.scene.mesh
    worst = np.zeros(3)
    rows = [("pose", "mean displacement [mm]", "mean difference [mm]", "relative", "largest [mm]",
             "vertebra [mm]", "force, SOFA [N]", "force, ours [N]", "peak penetration [mm]")]
    curves, failed = [], 0
    for path in track(sorted((data / "sofa" / "static").glob("*.npz")), "SOFA own contact"):
        field = StaticField.load(path, positions)
        found = simulate(simulator, field, cache)
        if not found.converged.all():
            failed += 1
            continue
        apart = found.displacement[-1] - field.displacement
        mean = np.linalg.norm(field.displacement, axis=1).mean()
        difference = np.linalg.norm(apart, axis=1)
        shift = max(float(np.linalg.norm(apart[mesh.part == k + 1].mean(axis=0))) for k in range(mesh.n_parts))
        force, own = np.linalg.norm(field.force), np.linalg.norm(found.probe_wrench[-1, :3])
        worst = np.maximum(worst, [difference.mean() / mean, shift, abs(own / force - 1.0)])
        rows.append((
            field.name, f"{mean:.3f}", f"{difference.mean():.3f}", f"{100 * difference.mean() / mean:.1f} %",
            f"{difference.max():.2f}", f"{shift:.3f}", f"{force:.2f}", f"{own:.2f}",
            f"{np.nanmax(found.penetration):.3f}",
        ))
        transient = data / "sofa" / path.name
        if transient.is_file():
            frames = Recording.load(transient).displacement
            apart = np.linalg.norm(found.displacement - frames, axis=2).mean(axis=1)
            curves.append((field.name, np.linalg.norm(frames, axis=2).mean(axis=1), apart))
    results = [Result.at_most(name, value, bar) for name, value, bar in zip(names, worst, bars, strict=True)]
    results.append(Result("SOFA static, poses not solved", float(failed), "= 0", failed == 0))

    def draw(axes):  # type: ignore[no-untyped-def]
        for name, mean, apart in curves:
            depth = np.arange(len(mean)) + 1 - APPROACH
            axes.plot(depth[mean > 0.05], 100.0 * (apart / np.maximum(mean, 1e-9))[mean > 0.05], label=name)
        axes.axhline(5.0, color="grey", linewidth=0.8, linestyle="--")
        axes.set(xlabel="depth [mm]", ylabel="difference / mean displacement [%]", ylim=(0.0, 30.0))
        axes.legend(frameon=False, fontsize=7)

    return Section(
        title,
        "The probe's path is replayed step by step with contact against SOFA's collision patch, which is tied to the "
        "mesh as SOFA ties it. In SOFA's static fields every probe and patch vertex keeps 2.00 mm, and vertex-face and "
        "edge-edge pairs at exactly that distance, each within its friction cone, reproduce all nodal forces. Two "
        "things decide about the agreement. First, SOFA's friction resists the motion of the skin in space: its "
        "probe is set from step to step without a velocity, so that the probe's own tangential motion does not drag "
        "the skin. Second, edges must meet edges: contact points on the probe are spaced closely. What remains are "
        "single contacts that stick on one side and slip on the other: friction keeps the history. The picture "
        "compares with SOFA's transient frames by depth; at the first touch inertia and the small displacement "
        "itself make the relative difference large, and sticking carries some of it along.",
        tuple(results), picture(folder, "sofa_contact", draw), tuple(rows),
    )
