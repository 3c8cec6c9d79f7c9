"""Where contact displacements come from: a CSV, JSON or NPZ file, or a sample of a simulation store."""

import csv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json
from mixpinn.records import Sample

_FIX = "write columns node, dx, dy, dz (.csv) or 'nodes' and 'displacements' (.json, .npz)"


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

    ``.csv``: four columns, node id and displacement, a header line or none. ``.json``: an object with ``nodes``, ids,
    and ``displacements``, three numbers each. ``.npz``: arrays of the same names.

    Returns:
        node ids, shape (c,), and displacements [mm], shape (c, 3).

    Raises:
        InputError: absent, unreadable, or of another layout.
    """
    path = Path(path)
    readers = {".csv": _read_csv, ".json": _read_json, ".npz": _read_npz}
    if path.suffix not in readers:
        raise InputError(str(path), expected=".csv, .json or .npz", got=path.suffix or "no suffix", fix=_FIX)
    if not path.is_file():
        raise InputError(str(path), expected="a file of contact nodes", got="no such file", fix="check the path")
    try:
        nodes, displacements = readers[path.suffix](path)
    except (KeyError, ValueError, TypeError, OSError, EOFError, zipfile.BadZipFile, csv.Error) as error:
        text = f"{type(error).__name__}: {error}"
        raise InputError(str(path), expected="contact nodes and their displacement", got=text, fix=_FIX) from error
    return nodes, displacements


def _read_csv(path: Path) -> tuple[AnyArray, AnyArray]:
    with path.open(newline="") as file:
        rows = [row for row in csv.reader(file) if row and not row[0].lstrip().startswith("#")]
    if rows and not any(_is_number(value) for value in rows[0]):
        rows = rows[1:]
    wrong = next((row for row in rows if len(row) != 4), None)
    if wrong is not None:
        raise ValueError(f"a row of {len(wrong)} instead of 4 columns: {','.join(wrong)}")
    nodes = np.array([int(row[0]) for row in rows], dtype=np.int64)
    return nodes, np.array([[float(value) for value in row[1:]] for row in rows], dtype=np.float64).reshape(-1, 3)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_json(path: Path) -> tuple[AnyArray, AnyArray]:
    values = read_json(path)
    return np.array(values["nodes"]), np.array(values["displacements"])


def _read_npz(path: Path) -> tuple[AnyArray, AnyArray]:
    with np.load(path, allow_pickle=False) as values:
        return values["nodes"], values["displacements"]


def read_sample(address: SampleAddress, *, mesh_hash: str) -> Sample:
    """Read one sample of a store; its contact nodes are the loaded ones.

    Args:
        address: which sample.
        mesh_hash: `TissueMesh.hash` of the model's mesh.

    Raises:
        InputError: the store is damaged or of another mesh, or has no such sample.
    """
    # Imported here: predicting from a list of nodes needs neither data sets nor a solver.
    from mixpinn.dataset import SimulationStore, table_of

    store = SimulationStore.open(address.store)
    if store.mesh_hash != mesh_hash:
        raise InputError(
            str(address.store), expected=f"simulations of the model's mesh {mesh_hash}", got=f"mesh {store.mesh_hash}",
            fix="choose the model that was trained on this store",
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
