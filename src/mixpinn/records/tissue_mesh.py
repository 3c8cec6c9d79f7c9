"""TissueMesh: the tetrahedral mesh with every node and cell labelled."""

import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import pyvista as pv

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, Int32Array, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.records.label_map import SCANNER_TO_WORLD
from mixpinn.records.tetrahedra import TETRA_FACES, signed_volumes
from mixpinn.records.vtk_file import write_vtk

MESH_FILE = "mesh.vtu"
"""Name of the mesh in every folder that holds one."""


@dataclass(frozen=True, eq=False)
class TissueMesh:
    """Tetrahedra of the soft tissue; rigid parts are cavities whose boundary nodes belong to them.

    Attributes:
        points: rest positions in the world frame [mm], float64, shape (n, 3).
        cells: positively oriented tetrahedra, int32, shape (m, 4).
        part: per node 0 for soft tissue or k = 1 … K for rigid part k, int16, shape (n,).
        fixed: nodes held in place, bool, shape (n,).
        rigid_names: names of the rigid parts 1 … K.
        tissue: per cell the index of its soft tissue, int16, shape (m,).
        tissue_names: names of the soft tissues 0, 1, …
        world_to_scanner: world frame [mm] to the scanner's RAS frame [mm], shape (4, 4).
    """

    points: FloatArray
    cells: Int32Array
    part: AnyArray
    fixed: BoolArray
    rigid_names: tuple[str, ...]
    tissue: AnyArray
    tissue_names: tuple[str, ...] = ("soft tissue",)
    world_to_scanner: FloatArray = field(default_factory=lambda: np.linalg.inv(SCANNER_TO_WORLD))

    @property
    def n_points(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def n_parts(self) -> int:
        """Number of rigid parts K."""
        return len(self.rigid_names)

    @cached_property
    def edges(self) -> IntArray:
        """Undirected edges of the cells, each once with i < j, sorted, shape (e, 2)."""
        pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
        ends = np.sort(np.concatenate([self.cells[:, pair] for pair in pairs]), axis=1).astype(np.int64)
        return np.unique(ends, axis=0)

    @cached_property
    def edge_part(self) -> AnyArray:
        """Part of each undirected edge: k where both ends belong to rigid part k, else 0; shape (e,)."""
        first, second = self.part[self.edges].T
        return np.where(first == second, first, 0)

    @cached_property
    def boundary_faces(self) -> IntArray:
        """Outward faces that belong to one cell only, shape (f, 3)."""
        faces = self.cells[:, TETRA_FACES].reshape(-1, 3).astype(np.int64)
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        return faces[np.sort(first[count == 1])]

    @cached_property
    def skin_faces(self) -> IntArray:
        """Outward boundary faces whose nodes are all soft tissue: the skin, without the cavities; shape (f, 3)."""
        faces = self.boundary_faces
        return faces[(self.part[faces] == 0).all(axis=1)]

    @cached_property
    def cell_volumes(self) -> FloatArray:
        """Signed volume of each cell [mm³], shape (m,)."""
        return signed_volumes(self.points, self.cells)

    @cached_property
    def deforming_cells(self) -> BoolArray:
        """Cells that can change shape: not all nodes fixed, nor all in one rigid part; shape (m,)."""
        group = np.where(self.part > 0, self.part.astype(np.int64), np.where(self.fixed, -1, 0))[self.cells]
        return (group == 0).any(axis=1) | (group != group[:, :1]).any(axis=1)

    def part_nodes(self, k: int) -> IntArray:
        """Node ids of rigid part k (1 … K), or of the soft tissue for k = 0."""
        return np.flatnonzero(self.part == k)

    def hash(self) -> str:
        """Identity of geometry and labels: what stores and checkpoints are tied to."""
        return hash_arrays(self.points, self.cells, self.part, self.fixed, self.tissue)

    def grid(self, displacement: AnyArray | None = None) -> pv.UnstructuredGrid:
        """The mesh as a `pyvista` grid with its labels, moved by `displacement` [mm] (n, 3) where given."""
        points = self.points if displacement is None else self.points + displacement
        cells = np.column_stack([np.full(len(self.cells), 4), self.cells])
        grid = pv.UnstructuredGrid(cells, np.full(len(self.cells), pv.CellType.TETRA), points)
        grid.point_data["part"] = self.part.astype(np.int16)
        grid.point_data["fixed"] = self.fixed.astype(np.uint8)
        grid.cell_data["tissue"] = self.tissue.astype(np.int16)
        if displacement is not None:
            grid.point_data["displacement"] = np.asarray(displacement)
        grid.field_data["rigid_names"] = [_ascii(name) for name in self.rigid_names] or [""]
        grid.field_data["tissue_names"] = [_ascii(name) for name in self.tissue_names]
        grid.field_data["world_to_scanner"] = self.world_to_scanner.ravel()
        return grid

    def save(self, path: Path | str) -> None:
        """Write a ``.vtu`` with the labels as point, cell and field data."""
        write_vtk(path, self.grid())

    @staticmethod
    def load(path: Path | str) -> "TissueMesh":
        """Read what `save` wrote (foreign meshes: `mixpinn.mesh.import_vtu`).

        Raises:
            InputError: absent, damaged, or without the labels.
        """
        path = Path(path)
        if not path.is_file():
            raise InputError(str(path), expected="a mesh (.vtu)", got="no such file", fix="check the path")
        try:
            with pv.vtk_verbosity("off"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                grid = pv.read(path)
        except Exception as error:  # readers raise many kinds: unknown suffix, XML, encoding
            raise InputError(
                str(path), expected="a readable mesh (.vtu)", got=f"{type(error).__name__}: {error}",
                fix="make or export the mesh again",
            ) from error
        if not {"part", "fixed"} <= set(grid.point_data) or "tissue" not in grid.cell_data:
            raise InputError(
                str(path), expected="point data 'part' and 'fixed' and cell data 'tissue'",
                got=f"point data {sorted(grid.point_data)}", fix="import it with 'mixpinn mesh FILE.vtu'",
            )
        names = tuple(_text(name) for name in grid.field_data["rigid_names"])
        return TissueMesh(
            np.asarray(grid.points, dtype=np.float64), np.asarray(grid.cells_dict[pv.CellType.TETRA], dtype=np.int32),
            np.asarray(grid.point_data["part"]), np.asarray(grid.point_data["fixed"]).astype(bool),
            tuple(name for name in names if name), np.asarray(grid.cell_data["tissue"]),
            tuple(_text(name) for name in grid.field_data["tissue_names"]),
            np.asarray(grid.field_data["world_to_scanner"], dtype=np.float64).reshape(4, 4),
        )


def _ascii(name: str) -> str:
    """The name as VTK's text arrays take it: other letters as Python escapes them."""
    return name.encode("unicode_escape").decode("ascii")


def _text(name: object) -> str:
    return str(name).encode("latin-1", "backslashreplace").decode("unicode_escape")
