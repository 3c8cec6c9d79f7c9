"""Fuzzing of meshes and probes of other programs.

In use a child process reads them, see `mixpinn.base.reader_process`. Here what is plain Python (meshio) is read in this
process, where its branches are seen, and bounded in memory and time as the child is; VTK, which can crash, stays in the
child; and what a child could hand over, sound or not, is made up without any file, many times as often.
"""

import json
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import numpy as np

_IN_CHILD = ("m.vtu", "m.vtk", "p.stl", "p.ply", "p.obj", "p.vtp")
_HERE = ("m.msh", "m.inp", "m.mesh", "m.bdf")
_HANDED_OVER = ("m.vtu", "p.stl")
NAMES = (*_HERE, *_HANDED_OVER, *_IN_CHILD)
_GROUPS = ("point_data", "cell_data", "field_data")
_CELLS = {"points", "connectivity", "offsets", "types"}
KINDS = ("bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64")
_LARGEST = 100_000
"""Numbers in an array that is made up."""
_MEMORY, _SECONDS = 2 << 30, 5.0


def read_foreign(folder: Path, content: bytes) -> None:
    """Read one mesh or probe; the first byte says of which kind and how it is handed over."""
    from mixpinn.mesh import read_grid
    from mixpinn.mesh.import_vtu import import_vtu
    from mixpinn.records import Probe, surface_file

    kind = content[0] % len(NAMES) if content else 0
    path = folder / NAMES[kind]
    read = Probe.load if path.name.startswith("p") else import_vtu
    if kind < len(_HERE):
        path.write_bytes(content[1:])
        with mock.patch.object(read_grid, "read_apart", _read_here):
            read(path)
    elif kind < len(_HERE) + len(_HANDED_OVER):
        path.write_bytes(b"")
        handed = _handed_over(content[1:])
        if handed is None:
            return
        module = surface_file if read is Probe.load else read_grid
        with mock.patch.object(module, "read_apart", return_value=handed):
            read(path)
    else:
        path.write_bytes(content[1:])
        read(path)


def _read_here(reader: Callable[[Path], tuple[object, object]], path: Path) -> tuple[object, object]:
    """`read_apart` in this process: whatever is raised is a `ValueError`, as it is there."""
    try:
        with _bounded():
            return reader(path)
    except BaseException as error:
        raise ValueError(f"{type(error).__name__}: {' '.join(str(error).split())[:300]}") from error


@contextmanager
def _bounded() -> Iterator[None]:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGVTALRM, _late)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + _MEMORY, hard))
    signal.setitimer(signal.ITIMER_VIRTUAL, _SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGVTALRM, before)


def _late(number: int, frame: object) -> None:
    raise TimeoutError


def _handed_over(content: bytes) -> "tuple[dict[str, np.ndarray], object] | None":
    """Arrays and plain values from a JSON: of each array the type, the shape and some numbers, which are repeated."""
    try:
        told = json.loads(content)
        about, arrays = told["about"], {}
        for name, (kind, shape, numbers) in told["arrays"].items():
            if not 0 <= np.prod([float(extent) for extent in shape]) <= _LARGEST or kind not in KINDS:
                return None
            with np.errstate(all="ignore"):
                arrays[name] = np.resize(np.array(numbers, dtype=np.float64).astype(kind), shape)
        return (arrays, about) if _as_a_child_would(arrays, about) else None
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError):
        return None


def _as_a_child_would(arrays: dict[str, np.ndarray], about: dict) -> bool:
    """Whether the plain values fit the arrays: a child makes them from what it has read."""
    if {"points", "triangles"} <= arrays.keys():
        return True
    words = [word for group in _GROUPS for word in about[group]]
    words += [word for name, texts in about["text"].items() for word in (name, *texts)]
    there = all(f"{group}.{index}" in arrays for group in _GROUPS for index in range(len(about[group])))
    return there and all(isinstance(word, str) for word in words) and arrays.keys() >= _CELLS


def foreign_seeds() -> list[bytes]:
    """Small sound files, and what a child hands over of them."""
    from drill.odd_files import grid, stl

    number = {name: bytes([index]) for index, name in reversed(list(enumerate(NAMES)))}
    child = {name: bytes([len(_HERE) + len(_HANDED_OVER) + index]) for index, name in enumerate(_IN_CHILD)}
    none = {"point_data": [], "cell_data": [], "field_data": [], "text": {}}
    tetra = {
        "points": ["float64", [5, 3], [0, 0, 0, 9, 0, 0, 0, 9, 0, 0, 0, 9, 9, 9, 9]],
        "connectivity": ["int64", [8], [0, 1, 2, 3, 1, 2, 3, 4]], "offsets": ["int64", [3], [0, 4, 8]],
        "types": ["uint8", [2], [10]],
    }
    data = {
        "point_data.0": ["int16", [5], [0, 0, 0, 0, 1]], "point_data.1": ["uint8", [5], [1, 0, 0, 0, 0]],
        "cell_data.0": ["int64", [2], [0, 1]], "field_data.0": ["float64", [16], [1, 0, 0, 0, 0]],
    }
    about = {
        "point_data": ["part", "fixed"], "cell_data": ["tissue"], "field_data": ["world_to_scanner"],
        "text": {"rigid_names": ["L1"], "tissue_names": ["soft tissue", "fat"], "doubts": [], "targets": ["L1"]},
    }
    faces = {"points": ["float64", [3, 3], [0, 0, 0, 9, 0, 0, 0, 9, 0]], "triangles": ["int64", [1, 3], [0, 1, 2]]}
    handed = [
        number["m.vtu"] + json.dumps({"arrays": tetra, "about": none}).encode(),
        number["m.vtu"] + json.dumps({"arrays": tetra | data, "about": about}).encode(),
        number["p.stl"] + json.dumps({"arrays": faces, "about": none}).encode(),
    ]
    inp = b"*NODE\n1,0,0,0\n2,9,0,0\n3,0,9,0\n4,0,0,9\n*ELEMENT, TYPE=C3D4\n1,1,2,3,4\n"
    medit = (
        b"MeshVersionFormatted 2\nDimension 3\nVertices\n4\n0 0 0 0\n9 0 0 0\n0 9 0 0\n0 0 9 0\n"
        b"Tetrahedra\n1\n1 2 3 4 0\nEnd\n"
    )
    nastran = (
        b"BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,9.,0.,0.\nGRID,3,,0.,9.,0.\nGRID,4,,0.,0.,9.\n"
        b"CTETRA,1,,1,2,3,4\nENDDATA\n"
    )
    msh4 = (
        b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n9 0 0\n0 9 0\n"
        b"0 0 9\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n"
    )
    return [
        *handed, number["m.msh"] + grid(".msh").encode(), number["m.msh"] + msh4, number["m.inp"] + inp,
        number["m.mesh"] + medit, number["m.bdf"] + nastran, child["m.vtu"] + grid(".vtu").encode(),
        child["m.vtk"] + grid(".vtk").encode(), child["p.stl"] + stl(),
    ]
