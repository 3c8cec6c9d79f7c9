"""TissueMesh: the tetrahedral mesh with every node and cell labelled."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, Int32Array, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.base.text import escaped, unescaped
from mixpinn.base.validated import ArraySpec
from mixpinn.records.doubts import packed, unpacked
from mixpinn.records.label_map import SCANNER_TO_WORLD
from mixpinn.records.mid_edges import edge_index, mid_edge_labels
from mixpinn.records.tetrahedra import TETRA_FACES, signed_volumes
from mixpinn.records.vtk_file import write_vtk
from mixpinn.records.vtu import TetraGrid

if TYPE_CHECKING:
    import pyvista as pv

MESH_FILE = "mesh.vtu"
"""Name of the mesh in every folder that holds one."""

CELL_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
"""Edges of a tetrahedron in the order of their midpoints in VTK's quadratic tetrahedron."""

FACE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
"""Edges of a triangle in the order of their midpoints in VTK's quadratic triangle."""

FACE_QUARTERS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
"""The four triangles between the nodes of a six-node face, oriented as the face."""


BESIDE = 25.0
"""Bones as far as this beside the targets, along x and z, are pressed too [mm]."""
_REMAKE = "make or export the mesh again"


@dataclass(frozen=True, eq=False)
class TissueMesh:
    """Tetrahedra of the soft tissue; rigid parts are cavities whose boundary nodes belong to them.

    The mesh is one of straight-sided cells between vertices; `order` says how the finite elements approximate
    displacements on it. With order 2 the midpoint of every edge is a node too: node n_points + e for row e of `edges`.
    What is said of points, edges and parts is said of the vertices, whatever the order; nodes are the vertices followed
    by the midpoints.

    Attributes:
        points: rest positions in the world frame [mm], float64, shape (n, 3).
        cells: positively oriented tetrahedra, int32, shape (m, 4).
        part: per node 0 for soft tissue or k = 1 … K for rigid part k, int16, shape (n,).
        fixed: nodes held in place, bool, shape (n,).
        rigid_names: names of the rigid parts 1 … K.
        tissue: per cell the index of its soft tissue, int16, shape (m,).
        tissue_names: names of the soft tissues 0, 1, …
        world_to_scanner: world frame [mm] to the scanner's RAS frame [mm], shape (4, 4).
        order: 1 for linear four-node cells, 2 for quadratic ten-node cells.
        doubts: what was noticed about it and what it was made from (see `mixpinn.records.doubts`).
        targets: rigid parts that are pressed on; empty where all are. Only where a probe goes depends on it.

    Raises:
        InputError: another order.
    """

    points: FloatArray
    cells: Int32Array
    part: AnyArray
    fixed: BoolArray
    rigid_names: tuple[str, ...]
    tissue: AnyArray
    tissue_names: tuple[str, ...] = ("soft tissue",)
    world_to_scanner: FloatArray = field(default_factory=lambda: np.linalg.inv(SCANNER_TO_WORLD))
    order: int = 1
    doubts: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.order not in (1, 2):
            raise InputError(
                "mesh", expected="order 1 (linear) or 2 (quadratic)", got=str(self.order), fix="choose one of them",
            )

    def with_order(self, order: int) -> "TissueMesh":
        """The same cells with another order of the finite elements."""
        return self if order == self.order else replace(self, order=order)

    @property
    def n_points(self) -> int:
        """Number of vertices."""
        return len(self.points)

    @property
    def n_nodes(self) -> int:
        """Number of nodes: the vertices, with order 2 also the midpoints of the edges."""
        return self.n_points if self.order == 1 else self.n_points + len(self.edges)

    @property
    def n_parts(self) -> int:
        """Number of rigid parts K."""
        return len(self.rigid_names)

    @cached_property
    def edges(self) -> IntArray:
        """Undirected edges of the cells, each once with i < j, sorted, shape (e, 2)."""
        pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
        ends = np.sort(np.concatenate([self.cells[:, pair] for pair in pairs]), axis=1).astype(np.int64)
        codes = np.unique(ends[:, 0] * self.n_points + ends[:, 1])
        return np.stack(np.divmod(codes, self.n_points), axis=1)

    @cached_property
    def node_points(self) -> FloatArray:
        """Rest positions of the nodes [mm], shape (n_nodes, 3)."""
        if self.order == 1:
            return self.points
        return np.concatenate([self.points, self.points[self.edges].mean(axis=1)])

    @cached_property
    def cell_nodes(self) -> IntArray:
        """Nodes of each cell, shape (m, 4), or (m, 10) in the order of VTK's quadratic tetrahedron."""
        if self.order == 1:
            return self.cells.astype(np.int64)
        middle = self.n_points + edge_index(self, self.cells[:, CELL_EDGES])
        return np.concatenate([self.cells.astype(np.int64), middle], axis=1)

    @cached_property
    def node_part(self) -> AnyArray:
        """Part of each node, int16, shape (n_nodes,); of midpoints as `mid_edge_labels` has it."""
        return self.part if self.order == 1 else np.concatenate([self.part, mid_edge_labels(self)[0]])

    @cached_property
    def node_fixed(self) -> BoolArray:
        """Nodes held in place, shape (n_nodes,); midpoints as `mid_edge_labels` has it."""
        return self.fixed if self.order == 1 else np.concatenate([self.fixed, mid_edge_labels(self)[1]])

    @property
    def target_points(self) -> FloatArray:
        """Vertices of the rigid parts that are pressed on [mm]: of all where none is named; without parts, all."""
        aimed = np.isin(self.part, [k for k, name in enumerate(self.rigid_names, start=1) if name in self.targets])
        chosen = aimed if aimed.any() else self.part > 0
        points: FloatArray = self.points[chosen] if chosen.any() else self.points
        return points

    @property
    def pressed_points(self) -> FloatArray:
        """Vertices over which a probe presses [mm]: `target_points`, and those of other parts close beside them.

        Of the first and the last bone above and below the targets a probe over these presses a good part too.
        """
        targets = self.target_points
        low, high = targets.min(axis=0) - BESIDE, targets.max(axis=0) + BESIDE
        near = ((self.points >= low) & (self.points <= high))[:, [0, 2]].all(axis=1) & (self.part > 0)
        return np.concatenate([targets, self.points[near]])

    @cached_property
    def held_parts(self) -> BoolArray:
        """Rigid parts that are held in place, all their nodes being fixed; shape (K,)."""
        return np.array([
            bool(self.fixed[self.part == k].all()) for k in range(1, self.n_parts + 1)
        ], dtype=bool)

    @cached_property
    def skin_node_faces(self) -> IntArray:
        """Nodes of the skin's faces, shape (f, 3), or (f, 6) in the order of VTK's quadratic triangle."""
        return self.skin_faces if self.order == 1 else self._face_nodes(self.skin_faces)

    @cached_property
    def skin_triangles(self) -> IntArray:
        """Triangles between the nodes of the skin, outward, shape (f, 3) or (4f, 3)."""
        if self.order == 1:
            return self.skin_faces
        return self.skin_node_faces[:, FACE_QUARTERS].reshape(-1, 3)

    def on_vertices(self, nodal: FloatArray) -> FloatArray:
        """Nodal forces (n_nodes, k) as the vertices' linear shape functions see them, shape (n_points, k).

        A linear shape function is the vertex's quadratic one and half of those at the midpoints of its edges, so that
        these are the forces that the same tractions give linear cells; their sum is kept.
        """
        if self.order == 1:
            return nodal
        vertices = nodal[:self.n_points].copy()
        for end in self.edges.T:
            np.add.at(vertices, end, 0.5 * nodal[self.n_points:])
        return vertices

    def _face_nodes(self, faces: IntArray) -> IntArray:
        return np.concatenate([faces, self.n_points + edge_index(self, faces[:, FACE_EDGES])], axis=1)

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
        part = self.node_part.astype(np.int64)
        group = np.where(part > 0, part, np.where(self.node_fixed, -1, 0))[self.cell_nodes]
        return (group == 0).any(axis=1) | (group != group[:, :1]).any(axis=1)

    def part_nodes(self, k: int) -> IntArray:
        """Node ids of rigid part k (1 … K), or of the soft tissue for k = 0."""
        return np.flatnonzero(self.part == k)

    def hash(self) -> str:
        """Identity of geometry, labels and order: what stores and checkpoints are tied to."""
        order = () if self.order == 1 else (np.array([self.order]),)
        return hash_arrays(self.points, self.cells, self.part, self.fixed, self.tissue, *order)

    def tetra_grid(self, displacement: AnyArray | None = None) -> TetraGrid:
        """The mesh with its labels as it is written, moved by `displacement` where given.

        Args:
            displacement: of all nodes [mm], shape (n_nodes, 3), or of the vertices alone, (n_points, 3), which makes a
                grid of linear cells.
        """
        if displacement is not None and self.order == 2 and len(displacement) == self.n_points:
            return self.with_order(1).tetra_grid(displacement)
        moved = {} if displacement is None else {"displacement": np.asarray(displacement)}
        return TetraGrid(
            self.node_points if displacement is None else self.node_points + displacement, self.cell_nodes,
            {"part": self.node_part.astype(np.int16), "fixed": self.node_fixed.astype(np.uint8), **moved},
            {"tissue": self.tissue.astype(np.int16)},
            {
                "rigid_names": [escaped(name) for name in self.rigid_names] or [""],
                "tissue_names": [escaped(name) for name in self.tissue_names],
                "world_to_scanner": self.world_to_scanner.ravel(), **packed(self.doubts),
                **({"targets": [escaped(name) for name in self.targets]} if self.targets else {}),
            },
        )

    def grid(self, displacement: AnyArray | None = None) -> "pv.UnstructuredGrid":
        """The same as a `pyvista` grid; operand as in `tetra_grid`."""
        import pyvista as pv

        return pv.UnstructuredGrid(self.tetra_grid(displacement).vtk())

    def save(self, path: Path | str) -> None:
        """Write a ``.vtu`` with the labels as point, cell and field data; VTK's quadratic tetrahedra with order 2."""
        write_vtk(path, self.tetra_grid().vtk())

    @staticmethod
    def load(path: Path | str) -> "TissueMesh":
        """Read what `save` wrote (foreign meshes: `mixpinn.mesh.import_vtu`).

        Raises:
            InputError: absent, damaged, without the labels, or quadratic with nodes elsewhere than halfway.
        """
        path = Path(path)
        if not path.is_file():
            raise InputError(str(path), expected="a mesh (.vtu)", got="no such file", fix="check the path")
        try:
            grid = TetraGrid.read(path)
        except ValueError as error:
            raise InputError(str(path), expected="a readable mesh (.vtu)", got=str(error), fix=_REMAKE) from error
        data = grid.field_data
        names = {"rigid_names", "tissue_names", "world_to_scanner"}
        if not {"part", "fixed"} <= set(grid.point_data) or "tissue" not in grid.cell_data or not names <= set(data):
            raise InputError(
                str(path), expected="point data 'part' and 'fixed' and cell data 'tissue'",
                got=f"point data {sorted(grid.point_data)}", fix="import it with 'mixpinn mesh FILE.vtu'",
            )
        _check_values(grid, str(path))
        nodes = grid.cells if grid.cells.shape[1] == 10 else None
        order, cells = (1, grid.cells) if nodes is None else (2, nodes[:, :4])
        points, n = grid.points, len(grid.points)
        if nodes is not None:
            n = int(nodes[:, 4:].min(initial=n))  # the vertices come first
        flat = int((signed_volumes(points, cells) <= 0.0).sum())
        if flat:
            raise InputError(
                str(path), expected="cells of positive volume", got=f"{flat} flat or inverted ones", fix=_REMAKE,
            )
        mesh = TissueMesh(
            points[:n], cells.astype(np.int32), grid.point_data["part"][:n],
            grid.point_data["fixed"].astype(bool)[:n], unpacked(data["rigid_names"]),
            grid.cell_data["tissue"], tuple(unescaped(name) for name in data["tissue_names"]),
            np.asarray(data["world_to_scanner"], dtype=np.float64).reshape(4, 4), order,
            unpacked(data.get("doubts", ())), unpacked(data.get("targets", ())),
        )
        if nodes is not None and not (
            cells.max() < n and mesh.n_nodes == len(points) and np.array_equal(mesh.cell_nodes, nodes)
            and np.allclose(mesh.node_points, points, rtol=0.0, atol=1e-6)
        ):
            raise InputError(
                str(path), expected="quadratic cells as this project writes them: vertices first, straight edges",
                got="other nodes", fix="import the linear mesh and choose quadratic elements afterwards",
            )
        return mesh


def _check_values(grid: TetraGrid, where: str) -> None:
    """Refuse values that no mesh has, as a damaged or an edited file may have them."""
    data = grid.field_data
    for name in ("rigid_names", "tissue_names", "doubts", "targets"):
        try:
            sound = isinstance(data.get(name, []), list) and all(
                unescaped(text) is not None for text in data.get(name, [])
            )
        except UnicodeDecodeError:
            sound = False
        if not sound:
            raise InputError(f"{where}: {name}", expected="texts", got="something else", fix=_REMAKE)
    unknown = sorted(set(unpacked(data.get("targets", ()))) - set(unpacked(data["rigid_names"])))
    if unknown:  # a mesh without targets that it knows would be pressed all over
        raise InputError(f"{where}: targets", expected="names of rigid parts", got=repr(unknown[0]), fix=_REMAKE)
    rigid, tissues = (sum(1 for name in data[names] if name) for names in ("rigid_names", "tissue_names"))
    arrays = {
        "points": (grid.points, ArraySpec("number", ("n", 3))),
        "part": (grid.point_data["part"], ArraySpec("index", ("n",), low=0, high=rigid)),
        "fixed": (grid.point_data["fixed"], ArraySpec("index", ("n",), low=0, high=1)),
        "tissue": (grid.cell_data["tissue"], ArraySpec("index", (len(grid.cells),), low=0, high=tissues - 1)),
        "world_to_scanner": (np.asarray(data["world_to_scanner"]).ravel(), ArraySpec("number", (16,))),
    }
    extents: dict[str, int] = {"n": len(grid.points)}
    for name, (array, spec) in arrays.items():
        spec.check(np.asarray(array), f"{where}: {name}", extents=extents, remake=_REMAKE)
