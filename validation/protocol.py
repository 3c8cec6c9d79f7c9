"""The paper's whole protocol, from the summary and the store that the simulation left."""

import shutil
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

from mixpinn.base.files import atomic_path
from mixpinn.dataset import GenerationSummary, InvertedCell, SimulationStore, list_inverted
from validation.result import Result, Section

POSES = 528
SHOWN = 12
"""Cells in the table."""


def with_inverted(summary: Path) -> GenerationSummary:
    """The summary; where an older one does not list inverted cells, they are sought in the store beside it."""
    totals = GenerationSummary.load(summary)
    folder = next((f for f in (summary.parent / "store", summary.parent) if (f / "store.json").is_file()), None)
    if totals.inverted is not None or folder is None:
        return totals
    store = SimulationStore.open(folder)
    return replace(totals, inverted=list_inverted(store, store.statuses()))


def by_cell(entries: tuple[InvertedCell, ...]) -> list[list[InvertedCell]]:
    """The entries of each cell, those of most poses first."""
    cells: dict[int, list[InvertedCell]] = defaultdict(list)
    for entry in entries:
        cells[entry.cell].append(entry)
    return sorted(cells.values(), key=lambda group: (-len(group), group[0].cell))


def inverted_text(entries: tuple[InvertedCell, ...]) -> str:
    """What kind of cells they are."""
    groups = by_cell(entries)
    if not groups:
        return "No cell is inverted in any step of any pose."
    worst = min(entries, key=lambda entry: entry.determinant)
    firsts = [group[0] for group in groups]
    kinds: dict[str, int] = defaultdict(int)
    for cell in firsts:
        rigid = len(cell.parts)
        kinds["between two rigid parts" if rigid > 1 else "beside one rigid part" if rigid else "in soft tissue"] += 1
    depths = sorted(entry.first_depth for entry in entries)
    return (
        f"{len(groups)} cells are inverted in {len({entry.pose for entry in entries})} poses, {len(entries)} pairs of "
        f"pose and cell and {sum(entry.steps for entry in entries)} of step and cell in all; ``summary.json`` lists "
        f"each pair. The first depth at which a pair is inverted is {depths[0]:g} mm at the least and "
        f"{np.median(depths):g} mm in the median. The worst is det F = {worst.determinant:.3g}, cell {worst.cell} in "
        f"{worst.pose} at {worst.depth:g} mm. By place: "
        + ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
        + f". Their volumes at rest are {min(c.volume for c in firsts):.3g} to {max(c.volume for c in firsts):.3g} mm³ "
        f"(median {np.median([c.volume for c in firsts]):.3g}), their radius ratios "
        f"{min(c.radius_ratio for c in firsts):.3g} to {max(c.radius_ratio for c in firsts):.3g} "
        f"(median {np.median([c.radius_ratio for c in firsts]):.3g}). The cells of most poses:"
    )


def inverted_rows(entries: tuple[InvertedCell, ...]) -> tuple[tuple[str, ...], ...]:
    """A table of the cells that are inverted in most poses."""
    rows = [(
        "cell", "rigid parts at its nodes", "volume [mm³]", "radius ratio", "poses", "first depth [mm]",
        "smallest det F", "in pose",
    )]
    for group in by_cell(entries)[:SHOWN]:
        worst = min(group, key=lambda entry: entry.determinant)
        rows.append((
            str(worst.cell), ", ".join(worst.parts) or "none", f"{worst.volume:.3g}", f"{worst.radius_ratio:.3g}",
            str(len(group)), f"{min(entry.first_depth for entry in group):g}", f"{worst.determinant:.3g}", worst.pose,
        ))
    return tuple(rows) if len(rows) > 1 else ()


def pose_map(summary: Path, folder: Path, name: str) -> str | None:
    """The picture of the pose grid that lies beside the summary, copied as `folder`/`name`.png; its name."""
    source = summary.parent / "poses.png"
    if not source.is_file():
        return None
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_path(folder / f"{name}.png") as temporary:
        shutil.copyfile(source, temporary)
    return f"{name}.png"


def run(summary: Path | None, folder: Path) -> Section:
    """The rows of the long run.

    Args:
        summary: ``summary.json`` of ``mixpinn simulate --protocol paper``, or None where there is no run.
        folder: of the picture.
    """
    title = "The paper's protocol"
    if summary is None or not summary.is_file():
        return Section(title, "Not run: pass the summary of a finished simulation with `--summary`.", (
            Result("paper's protocol, poses done", float("nan"), f"= {POSES}", False),
        ))
    totals = with_inverted(summary)
    penetration = totals.peak_penetration[0] if totals.peak_penetration else float("nan")
    residual = totals.worst_residual[0] if totals.worst_residual else float("nan")
    results = [
        Result("paper's protocol, poses done", float(totals.done), f"= {POSES}", totals.done == POSES),
        Result("paper's protocol, steps that did not converge", float(totals.failed_steps), "= 0",
               totals.failed_steps == 0),
        Result.at_most("paper's protocol, penetration of the gap [mm]", penetration, 0.1),
        Result.at_most("paper's protocol, worst relative residual", residual, 1e-6),
        Result.at_most("paper's protocol, wall time [min]", totals.wall_seconds / 60.0, 60.0),
        Result("paper's protocol, inverted cells listed by pose and cell",
               float("nan") if totals.inverted is None else float(len(totals.inverted)), "listed",
               totals.inverted is not None),
    ]
    text = totals.markdown()
    if totals.inverted is not None:
        text += "\nNeither published energy forbids det F ≤ 0. " + inverted_text(totals.inverted)
    picture = pose_map(summary, folder, "protocol")
    return Section(title, text, tuple(results), picture, inverted_rows(totals.inverted or ()))


def run_own(summary: Path | None, folder: Path) -> Section:
    """The same protocol on the project's own mesh.

    Args:
        summary: ``summary.json`` of ``mixpinn simulate`` on a mesh that ``mixpinn mesh`` made, or None.
        folder: of the picture.
    """
    title = "The protocol on the own mesh"
    if summary is None or not summary.is_file():
        return Section(title, "Not run: pass the summary of a finished simulation with `--own-summary`.", (
            Result("own mesh, inverted cells", float("nan"), "= 0", False),
        ))
    totals = with_inverted(summary)
    count = float("nan") if totals.inverted is None else float(len(totals.inverted))
    smallest = totals.min_jacobian[0] if totals.min_jacobian else float("nan")
    results = [
        Result("own mesh, inverted cells, pairs of pose and cell", count, "= 0", count == 0.0),
        Result("own mesh, smallest det F", smallest, "> 0", smallest > 0.0),
        Result("own mesh, poses done", float(totals.done), f"= {totals.poses}", totals.done == totals.poses),
        Result("own mesh, steps that did not converge", float(totals.failed_steps), "= 0", totals.failed_steps == 0),
    ]
    text = (
        "The mesh is what `mixpinn mesh` makes of the patient's label maps at `--size 1`; the protocol is `anatomy` "
        "(positions every 10 mm over the rigid parts, four rotations, 20 steps from first touch), with E = 25.4 kPa, "
        "ν = 0.45 and the paper's probe.\n\n" + totals.markdown()
    )
    if totals.inverted is not None:
        text += "\n" + inverted_text(totals.inverted)
    picture = pose_map(summary, folder, "own_mesh")
    return Section(title, text, tuple(results), picture, inverted_rows(totals.inverted or ()))
