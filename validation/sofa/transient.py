"""SOFA's transient frames with our own contact, by depth, and where the differences come from."""

from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.progress import track
from mixpinn.fem import PAPER_TISSUE, ElasticSystem
from validation.result import Result, Section, picture
from validation.sofa.contact import replayer, simulate
from validation.sofa.fields import APPROACH, Recording, StaticField, data_folder
from validation.sofa.imposed import kept_differences

EVERY = 5
"""Of the recorded poses every fifth is replayed, besides those with a static field."""


def chosen(data: Path) -> list[Path]:
    """The recordings that are replayed."""
    poses = sorted((data / "sofa").glob("pose_*.npz"))
    static = {path.stem for path in (data / "sofa" / "static").glob("*.npz")}
    return [path for k, path in enumerate(poses) if path.stem in static or k % EVERY == 0]


def replayed(data: Path, recording: Recording, positions: FloatArray) -> StaticField:
    """The recording's path; that of its static field where there is one, so that the simulation is shared."""
    static = data / "sofa" / "static" / f"{recording.name}.npz"
    if static.is_file():
        return StaticField.load(static, positions)
    return StaticField(recording.name, recording.displacement[-1], np.zeros(3), recording.path())


def frame_errors(own: FloatArray, frames: FloatArray) -> FloatArray:
    """Per step: SOFA's mean displacement, mean difference, and the same against our next step [mm], shape (s, 3).

    Our next step has the probe 1 mm deeper: where SOFA's body stands while its collision mesh trails by a step.
    """
    def mean(field: FloatArray) -> FloatArray:
        return np.linalg.norm(field, axis=2).mean(axis=1)

    unlagged = np.full(len(frames), np.nan)
    unlagged[:-1] = mean(own[1:] - frames[:-1])
    return np.column_stack([mean(frames), mean(own - frames), unlagged])


def run(folder: Path, *, cache: Path, imposed: Path, compute: bool = True) -> Section:
    """The check; poses once simulated are kept in `cache`.

    Args:
        folder: of the picture.
        cache: folder of simulations, shared with the static check.
        imposed: folder of what the check with imposed contact has kept; made where it lacks a pose.
        compute: simulate poses that are missing.
    """
    title, data = "SOFA's transient frames, own contact", data_folder()
    if data is None:
        return Section(title, "Not run: the recorded fields are absent.", (
            Result("SOFA transient, frames compared", np.nan, "reported", False),
        ))
    simulator, positions = replayer(data)
    system = ElasticSystem(simulator.scene.mesh, [PAPER_TISSUE])
    tables, names, failed = [], [], 0
    for path in track(chosen(data), "SOFA transient"):
        recording = Recording.load(path)
        field = replayed(data, recording, positions)
        if not compute and not (cache / f"{field.name}-{simulator.scene.hash()[:16]}").is_dir():
            continue
        found = simulate(simulator, field, cache)
        if not found.converged.all():
            failed += 1
            continue
        errors = frame_errors(found.displacement.astype(np.float64), recording.displacement)
        loaded = np.array([np.abs(force).max(initial=0.0) > 0.0 for force in recording.forces])
        errors[~loaded] = np.nan
        tables.append(np.column_stack([errors, kept_differences(system, recording, imposed)[:, 0]]))
        names.append(recording.name)
    table = np.stack(tables)
    depth = np.arange(table.shape[1]) + 1 - APPROACH
    rows = [("depth [mm]", "frames", "mean displacement [mm]", "mean difference [mm]", "relative",
             "of it without contact [mm]", "worst frame [mm]", "against our next step [mm]")]
    groups = [("before 1", depth < 1)] + [(str(d), depth == d) for d in range(1, int(depth.max()) + 1)]
    for label, mask in groups:
        part = table[:, mask].reshape(-1, 4)
        part = part[~np.isnan(part[:, 0])]
        if len(part):
            mean = part.mean(axis=0)
            lag = "–" if np.isnan(part[:, 2]).all() else f"{np.nanmean(part[:, 2]):.3f}"
            rows.append((label, str(len(part)), f"{mean[0]:.3f}", f"{mean[1]:.3f}", f"{100 * mean[1] / mean[0]:.1f} %",
                         f"{mean[3]:.4f}", f"{part[:, 1].max():.3f}", lag))
    flat = table.reshape(-1, 4)
    flat = flat[~np.isnan(flat[:, 0])]
    last = table[:, -1]
    results = [
        Result("SOFA transient, poses replayed", float(len(tables)), f"= {len(chosen(data))}",
               len(tables) == len(chosen(data))),
        Result("SOFA transient, poses not solved", float(failed), "= 0", failed == 0),
        Result("SOFA transient, mean difference over all frames with load [mm]", float(flat[:, 1].mean()), "reported",
               True),
        Result("SOFA transient, mean difference relative to the mean displacement, deepest frame",
               float((last[:, 1] / last[:, 0]).mean()), "reported", True),
    ]

    def draw(axes):  # type: ignore[no-untyped-def]
        for one in table:
            axes.semilogy(depth, one[:, 1], color="tab:blue", alpha=0.3, linewidth=0.8)
            axes.semilogy(depth, one[:, 3], color="tab:orange", alpha=0.3, linewidth=0.8)
        axes.semilogy([], [], color="tab:blue", label="own contact")
        axes.semilogy([], [], color="tab:orange", label="SOFA's contact displacements imposed")
        met = ~np.isnan(table[:, :, 0]).all(axis=0)
        axes.semilogy(depth[met], np.nanmean(table[:, met, 0], axis=0), "k--", linewidth=0.8, label="mean displacement")
        axes.set(xlabel="depth [mm]", ylabel="mean difference [mm]")
        axes.legend(frameon=False, fontsize=7)

    return Section(
        title,
        f"The recorded poses that have a static field and every {EVERY}th of all are replayed step by step with our "
        "own contact and held against SOFA's frames. Four things may differ. *Inertia and the single "
        "linearised step* of each frame: what remains with SOFA's contact displacements imposed, where "
        "contact plays no part (column *of it without contact*). *The lag of the collision mesh*: it trails "
        "SOFA's body by one step, and the replay puts the probe where the collision mesh was; whoever "
        "compares with the body's position instead would find the last column. *Friction's history*: a "
        "contact sticks where it first touched, and SOFA first touches in motion. What is left at depth, "
        "beyond the column without contact, is most likely of this kind: in the static fields above inertia "
        "has died away, and a difference of the same size remains. *The law of contact*: a penalty against "
        "exact constraints, by no more than the peak penetration of the gap given above.",
        tuple(results), picture(folder, "sofa_transient", draw), tuple(rows),
    )
