"""Inverted cells of a store: which cells a load turned inside out, in which poses, at which depths."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.validated import load_record, save_record
from mixpinn.dataset.status import PoseState, PoseStatus
from mixpinn.dataset.store import SimulationStore
from mixpinn.fem.elements.jacobians import smallest_jacobians
from mixpinn.mesh.checks.quality import radius_ratios
from mixpinn.records import Simulation, TissueMesh
from mixpinn.records.tetrahedra import signed_volumes

KNOWN = "inverted.json"


@dataclass(frozen=True)
class InvertedCell:
    """One cell that a pose inverted.

    Attributes:
        pose: name of the pose.
        cell: index of the cell in the mesh.
        steps: number of converged steps in which det F ≤ 0.
        step: the step of them with the smallest det F.
        depth: depth of that step [mm].
        first_depth: depth of the first of them [mm].
        determinant: det F at that step.
        parts: names of the rigid parts that its nodes belong to.
        soft_nodes: number of its nodes that belong to none.
        tissue: name of its tissue.
        volume: at rest [mm³].
        radius_ratio: 3 r / R at rest; 1 for the regular tetrahedron, 0 for a flat one.
    """

    pose: str
    cell: int
    steps: int
    step: int
    depth: float
    first_depth: float
    determinant: float
    parts: tuple[str, ...]
    soft_nodes: int
    tissue: str
    volume: float
    radius_ratio: float


def inverted_cells(mesh: TissueMesh, simulation: Simulation, pose: str) -> list[InvertedCell]:
    """Cells with det F ≤ 0 in a converged step of `simulation`, by cell.

    A linear tetrahedron deforms by one F, so that det F is its deformed over its undeformed volume; of a quadratic one
    the smallest det F at its quadrature points counts.

    Args:
        mesh: the mesh that was simulated.
        simulation: with displacements [mm].
        pose: its name.
    """
    rest = signed_volumes(mesh.points, mesh.cells)
    found: dict[int, list[tuple[float, int]]] = {}
    for step in np.flatnonzero(simulation.converged & ~(simulation.min_jacobian > 0.0)):  # also where it is unknown
        ratio = smallest_jacobians(mesh, simulation.displacement[step])
        for cell in np.flatnonzero(ratio <= 0.0):
            found.setdefault(int(cell), []).append((float(ratio[cell]), int(step)))
    cells = np.array(sorted(found), dtype=np.int64)
    shapes = radius_ratios(mesh.points, mesh.cells[cells]) if len(cells) else np.empty(0)
    entries = []
    for cell, shape in zip(cells.tolist(), shapes, strict=True):
        (determinant, at), first = min(found[cell]), found[cell][0][1]
        part = mesh.part[mesh.cells[cell]]
        entries.append(InvertedCell(
            pose, cell, steps=len(found[cell]), step=at, depth=float(simulation.path.depths[at]),
            first_depth=float(simulation.path.depths[first]), determinant=determinant,
            parts=tuple(mesh.rigid_names[k - 1] for k in np.unique(part[part > 0])),
            soft_nodes=int((part == 0).sum()), tissue=mesh.tissue_names[mesh.tissue[cell]], volume=float(rest[cell]),
            radius_ratio=float(shape),
        ))
    return entries


def list_inverted(store: SimulationStore, statuses: Sequence[PoseStatus]) -> tuple[InvertedCell, ...]:
    """Inverted cells of all finished poses of `store`, by pose and cell.

    Poses whose smallest det F is known to be positive are not opened. What is found is kept in the store's
    ``inverted.json`` under the content hash of each pose, so that a store is summarised again at no cost.

    Args:
        store: the simulations.
        statuses: of its poses.
    """
    path = store.folder / KNOWN
    kept = _known(path)
    entries: dict[str, _Kept] = {}
    mesh: TissueMesh | None = None
    poses = {pose.name: pose for pose in store.poses}
    for status in statuses:
        if status.state is not PoseState.DONE or (status.min_jacobian is not None and status.min_jacobian > 0.0):
            continue
        entry = kept.get(status.name)
        if entry is None or entry.hash != status.content_hash:
            mesh = mesh or store.mesh()
            cells = inverted_cells(mesh, store.load(poses[status.name]), status.name)
            entry = _Kept(status.content_hash, tuple(cells))
        entries[status.name] = entry
    if entries != kept:
        save_record(path, entries)
    return tuple(cell for entry in entries.values() for cell in entry.cells)


@dataclass(frozen=True)
class _Kept:
    """What ``inverted.json`` keeps of a pose."""

    hash: str
    cells: tuple[InvertedCell, ...]


def _known(path: Path) -> dict[str, _Kept]:
    """What an earlier call kept; nothing where that is absent or damaged."""
    if not path.is_file():
        return {}
    try:
        return load_record(dict[str, _Kept], path, remake="delete it: the cells are sought again")
    except InputError:
        return {}
