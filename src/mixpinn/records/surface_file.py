"""Reading triangle surfaces from whatever file they are in, in a process of its own."""

from pathlib import Path

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.reader_process import read_apart
from mixpinn.base.validated import ArraySpec
from mixpinn.records.strict_vtk import strict_vtk
from mixpinn.records.triangle_edges import edge_uses


def read_surface(path: Path | str, *, expected: str, fix: str) -> tuple[FloatArray, IntArray]:
    """Read any surface that `pyvista` reads (.stl, .ply, .vtp, .obj); duplicate vertices are merged.

    Triangles that face the other way than their neighbours are turned: what lies behind a surface is then the same
    everywhere.

    Args:
        path: the file.
        expected: what it should be, for messages.
        fix: how to mend it.

    Returns:
        Vertices, shape (p, 3), and triangles, shape (t, 3).

    Raises:
        InputError: absent, unreadable, without triangles, or with vertices that are not finite.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(str(path), expected=expected, got="no such file", fix="check the path")
    try:
        arrays, _ = read_apart(surface_arrays, path)
    except ValueError as error:
        raise InputError(str(path), expected=expected, got=str(error), fix=fix) from error
    points, triangles = arrays["points"], arrays["triangles"]
    if not triangles.size:
        raise InputError(str(path), expected=expected, got="0 readable triangles", fix=fix)
    ArraySpec("number", ("p", 3)).check(points, f"{path}: points", extents={}, remake=fix)
    faces = ArraySpec("index", ("t", 3), low=0, high=len(points) - 1)
    faces.check(triangles, f"{path}: triangles", extents={}, remake=fix)
    return points.astype(np.float64), triangles.astype(np.int64)


_STL_HEAD, _STL_TRIANGLE = 84, 50
"""Bytes before the first triangle of a binary STL, and of each."""


def surface_arrays(path: Path) -> tuple[dict[str, AnyArray], None]:
    """Points and triangles of a file: what the process of its own runs."""
    import pyvista as pv

    if path.suffix.lower() == ".stl":
        _check_length(path)
    with strict_vtk():
        read = pv.read(path)
    surface = read.extract_surface(algorithm="dataset_surface").triangulate().clean()
    triangles = np.asarray(surface.regular_faces, dtype=np.int64).reshape(-1, 3)
    _, faces, along = edge_uses(triangles)
    if ((faces == 2) & (along != 1)).any():
        surface = surface.compute_normals(
            point_normals=False, split_vertices=False, consistent_normals=True, auto_orient_normals=False,
        )
        triangles = np.asarray(surface.regular_faces, dtype=np.int64).reshape(-1, 3)
    return {"points": np.asarray(surface.points, dtype=np.float64), "triangles": triangles}, None


def _check_length(path: Path) -> None:
    """A binary STL says how many triangles it has; a reader may take as many as there are."""
    with path.open("rb") as file:
        head = file.read(_STL_HEAD)
    if head.lstrip().startswith(b"solid") and b"facet" in path.read_bytes()[:4096]:
        return  # text
    count = int.from_bytes(head[80:84], "little")
    if len(head) < _STL_HEAD or path.stat().st_size < _STL_HEAD + _STL_TRIANGLE * count:
        raise ValueError(f"a file that is too short for the {count} triangles that it announces")
