"""SOFA's frames with the displacement of its contact nodes imposed: tests the elastic bodies without contact."""

from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.files import atomic_path
from mixpinn.base.progress import track
from mixpinn.fem import PAPER_TISSUE, ElasticSystem, default_solver
from validation.newton import equilibrium
from validation.result import Result, Section, picture
from validation.sofa.fields import APPROACH, Recording, data_folder, paper_mesh

QUICK = 2
"""Poses that are computed where not all are asked for."""


def differences(system: ElasticSystem, recording: Recording) -> FloatArray:
    """Mean and largest difference [mm] from SOFA and SOFA's mean displacement, a row a frame; NaN without contact."""
    mesh = system.mesh
    state, linear = system.rest_state(), default_solver(1)
    rows = np.full((len(recording.displacement), 3), np.nan)
    for step, (expected, nodes, forces) in enumerate(
        zip(recording.displacement, recording.nodes, recording.forces, strict=True)
    ):
        loaded = nodes[np.abs(forces).max(axis=1, initial=0.0) > 0.0]
        if not len(loaded):
            continue
        dofs = system.node_dofs(loaded)
        held, shift = np.zeros(system.n_dofs, dtype=bool), np.zeros(system.n_dofs)
        free = dofs >= 0
        held[dofs[free]] = True
        shift[dofs[free]] = (mesh.points[loaded] + expected[loaded] - state.points[loaded])[free]
        found = equilibrium(system, state, held=held, shift=shift, tolerance=1e-6, linear=linear)
        if not found.converged:  # an indefinite tangent led astray
            found = equilibrium(system, state, held=held, shift=shift, tolerance=1e-6, linear=linear, project=True)
        if not found.converged:
            rows[step] = np.inf
            continue
        state = found.state
        apart = np.linalg.norm(state.points - mesh.points - expected, axis=1)
        rows[step] = apart.mean(), apart.max(), np.linalg.norm(expected, axis=1).mean()
    return rows


def kept_differences(system: ElasticSystem, recording: Recording, cache: Path) -> FloatArray:
    """`differences`, computed once and kept in `cache`."""
    kept = cache / f"{recording.name}.npy"
    if not kept.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        rows = differences(system, recording)
        with atomic_path(kept) as temporary, open(temporary, "wb") as file:
            np.save(file, rows)
    table: FloatArray = np.load(kept)
    return table


def run(folder: Path, *, cache: Path, full: bool = False) -> Section:
    """The check; poses once computed are kept in `cache`, and all that are there count.

    Args:
        folder: of the picture.
        cache: folder of what was computed before.
        full: compute all poses that are missing.
    """
    title, name = "SOFA's frames, contact displacements imposed", "SOFA imposed, mean difference [mm]"
    data = data_folder()
    if data is None:
        return Section(title, "Not run: the recorded fields are absent.", (Result(name, np.nan, "≤ 0.01", False),))
    system = ElasticSystem(paper_mesh(data), [PAPER_TISSUE])
    poses = sorted((data / "sofa").glob("pose_*.npz"))
    known = [path for path in poses if (cache / f"{path.stem}.npy").is_file()]
    wanted = poses if full else sorted({*known, *poses[:: max(1, len(poses) // QUICK)][:QUICK]})
    tables = []
    for path in track(wanted, "SOFA imposed"):
        tables.append(kept_differences(system, Recording.load(path), cache))
    table = np.stack(tables)
    used = ~np.isnan(table[..., 0])
    # Frames before depth 1 count where they carry load, as one group.
    depth = np.arange(table.shape[1]) + 1 - APPROACH
    groups = [("before 1", depth < 1)] + [(str(d), depth == d) for d in range(1, int(depth.max()) + 1)]
    rows = [("depth [mm]", "frames", "mean displacement [mm]", "mean difference [mm]", "worst frame's mean [mm]",
             "largest [mm]")]
    for label, chosen in groups:
        part = table[:, chosen][used[:, chosen]]
        if len(part):
            rows.append((label, str(len(part)), f"{part[:, 2].mean():.3f}", f"{part[:, 0].mean():.4f}",
                         f"{part[:, 0].max():.4f}", f"{part[:, 1].max():.3f}"))
    values = table[used]

    def draw(axes):  # type: ignore[no-untyped-def]
        for one, mask in zip(table, used, strict=True):
            axes.semilogy(depth[mask], one[mask, 0], color="tab:blue", alpha=0.25, linewidth=0.8)
        axes.axhline(0.01, color="grey", linewidth=0.8, linestyle="--")
        axes.set(xlabel="depth [mm]", ylabel="mean difference [mm]")

    return Section(
        title,
        "In every frame with contact the nodes that carry contact force are moved to where SOFA has them, and static "
        "equilibrium of the rest is found by Newton's method. SOFA's frames are steps of implicit dynamics, so that a "
        "part of the difference is inertia; their displacements are rounded to a micrometre.",
        (
            Result.at_most(name, float(values[:, 0].mean()), 0.01),
            Result("SOFA imposed, poses", float(len(tables)), f"= {len(poses)}", len(tables) == len(poses)),
            Result("SOFA imposed, frames not solved", float(np.isinf(values[:, 0]).sum()), "= 0",
                   not np.isinf(values[:, 0]).any()),
        ),
        picture(folder, "sofa_imposed", draw), tuple(rows),
    )
