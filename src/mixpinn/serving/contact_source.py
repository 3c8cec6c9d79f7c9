"""Where contact displacements come from: a table, a JSON or NPZ file, or a sample of a simulation store."""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.array_file import read_npz
from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json
from mixpinn.base.text_table import read_columns, require_unit
from mixpinn.records import Sample

_FIX = "write columns node, dx, dy, dz [mm] under these names (.csv) or 'nodes' and 'displacements' (.json, .npz)"
_ARRAYS, _UNITS = ("nodes", "displacements"), ("unit", "units")
_COLUMNS = {
    "node": ("nodes", "node_id", "nodeid", "node_number", "id", "index", "point_id", "vtkoriginalpointids"),
    **{
        f"d{axis}": (f"u{axis}", f"u_{axis}", f"d_{axis}", f"displacement_{axis}", f"displacement:{k}",
                     f"displacement_{k}") for k, axis in enumerate("xyz")
    },
}
"""What the columns of a table may be called."""


_LARGEST_MOVE = 100.0
"""A column without a name whose numbers are no larger may be displacements [mm]."""
_MOST = 1 << 28
"""Size of one array of an archive of contacts [byte]; a hundred times what a whole mesh has."""


@dataclass(frozen=True)
class SampleAddress:
    """A sample of a simulation store.

    Attributes:
        store: folder of the store.
        position_index: index of the probe position.
        rotation_deg: rotation of the probe [degree].
        depth: indentation depth [mm]; None means the deepest.
    """

    store: Path
    position_index: int
    rotation_deg: float
    depth: float | None = None


def read_contacts(path: Path | str) -> tuple[AnyArray, AnyArray]:
    """Read contact nodes and their displacement.

    ``.csv``, ``.tsv``, ``.txt``: a table with the columns ``node``, ``dx``, ``dy`` and ``dz`` (see `read_columns`),
    found by the line of their names and only without one by their order, where only the first can be ids. ``.json``: an
    object with ``nodes``, ids, and ``displacements``, three numbers each. ``.npz``: arrays of the same names.

    Returns:
        node ids, shape (c,), and displacements [mm], shape (c, 3).

    Raises:
        InputError: absent, unreadable, or of another layout.
    """
    path = Path(path)
    readers = {
        **dict.fromkeys((".csv", ".tsv", ".txt", ".dat"), _read_table), ".json": _read_json, ".npz": _read_npz,
    }
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise InputError(
            str(path), expected="a table (.csv, .tsv, .txt), .json or .npz", got=suffix or "no suffix", fix=_FIX,
        )
    if not path.is_file():
        raise InputError(str(path), expected="a file of contact nodes", got="no such file", fix="check the path")
    try:
        nodes, displacements = readers[suffix](path)
    except (KeyError, ValueError, TypeError, OSError, EOFError, zipfile.BadZipFile) as error:
        expected = "contact nodes and their displacement"
        raise InputError(str(path), expected=expected, got=str(error), fix=_FIX) from error
    return _whole(path, np.asarray(nodes)), displacements


def _whole(path: Path, nodes: AnyArray) -> AnyArray:
    """Node ids as integers, also where a program wrote them as 302.0."""
    if nodes.dtype.kind != "f":
        return nodes
    wrong = nodes[~(np.isfinite(nodes) & (nodes == np.rint(nodes)) & (np.abs(nodes) < 2.0**53))]
    if len(wrong):
        raise InputError(str(path), expected="whole numbers as node ids", got=f"{wrong[0]:g}", fix=_FIX)
    return nodes.astype(np.int64)


def _read_table(path: Path) -> tuple[AnyArray, AnyArray]:
    values = read_columns(
        path, _COLUMNS, unit="mm", expected="contact nodes and their displacement", fix=_FIX, doubt=_other_ids,
    )
    return values[:, 0], values[:, 1:]


def _other_ids(rows: FloatArray) -> str:
    """Why the first column of a table without names may be another one than the ids; nothing where it cannot."""
    largest = rows.max(axis=0)
    for index in range(1, rows.shape[1]):
        column = rows[:, index]
        whole = bool((column >= 0.0).all() and (column == np.rint(column)).all())
        alike = largest[0] <= _LARGEST_MOVE or largest[index] >= largest[0]
        if whole and alike and len(np.unique(column)) == len(column):
            return f"no names, and column {index + 1} may hold the ids as well as the first"
    return ""


def _read_json(path: Path) -> tuple[AnyArray, AnyArray]:
    values = read_json(path)
    if not isinstance(values, dict) or not set(_ARRAYS) <= set(values):
        raise ValueError(f"no entries {' and '.join(map(repr, _ARRAYS))}")
    for name in _UNITS:
        if name in values:
            require_unit(str(values[name]), "mm", f"{path}: {name}", fix=_FIX)
    return np.array(values["nodes"]), np.array(values["displacements"])


def _read_npz(path: Path) -> tuple[AnyArray, AnyArray]:
    values = read_npz(path, most=_MOST)
    if not set(_ARRAYS) <= set(values):
        raise ValueError(f"no arrays {' and '.join(map(repr, _ARRAYS))}")
    for name in _UNITS:
        if name in values:
            require_unit(str(values[name]), "mm", f"{path}: {name}", fix=_FIX)
    return values["nodes"], values["displacements"]


def read_sample(address: SampleAddress, *, mesh_hash: str, made_on: str = "") -> Sample:
    """Read one sample of a store; its contact nodes are the loaded ones.

    Args:
        address: which sample.
        mesh_hash: `TissueMesh.hash` of the model's mesh.
        made_on: the model's discretisation in words, for the message.

    Raises:
        InputError: the store is damaged or of another mesh, or has no such sample.
    """
    # Imported here: predicting from a list of nodes needs neither data sets nor a solver.
    from mixpinn.dataset import SimulationStore, table_of

    store = SimulationStore.open(address.store)
    if store.mesh_hash != mesh_hash:
        raise InputError(
            str(address.store), expected=f"simulations of the model's {made_on or f'mesh, {mesh_hash}'}",
            got=f"those of {store.discretisation or f'another mesh, {store.mesh_hash}'}",
            fix="choose a model that was trained on this store, or simulate on the mesh.vtu of the model's folder",
        )
    poses = [
        pose for pose in store.poses
        if pose.position_index == address.position_index and pose.rotation_deg == address.rotation_deg
    ]
    if not poses:
        raise InputError(
            str(address.store), expected="a pose of the store",
            got=f"position {address.position_index} at {address.rotation_deg:g}°",
            fix=f"choose one of its {len(store.poses)} poses, listed in store.json",
        )
    table = table_of([store.load(poses[0])])
    depths = ", ".join(f"{depth:g}" for depth in table.depth)
    matching = np.argsort(table.depth, kind="stable")
    if address.depth is not None:
        matching = np.flatnonzero(np.isclose(table.depth, address.depth))
    if len(matching) == 0:
        raise InputError(
            str(address.store), expected=f"one of the depths {depths or '(none: nothing is loaded)'} mm",
            got="the deepest" if address.depth is None else f"{address.depth:g} mm", fix="choose another depth or pose",
        )
    return table[int(matching[-1])]
