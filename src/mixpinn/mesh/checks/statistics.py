"""The paper's mesh table: points and directed edges of each part."""

from dataclasses import dataclass

import numpy as np
from rich.table import Table

from mixpinn.records.tissue_mesh import TissueMesh


@dataclass(frozen=True)
class PartStatistics:
    """One row of the mesh table.

    Attributes:
        label: 0 for soft tissue, k = 1 … K for rigid part k.
        name: of the part.
        points: mesh nodes of the part.
        edges: directed edges of the part: both ends in rigid part k; all others count as soft tissue.
    """

    label: int
    name: str
    points: int
    edges: int


@dataclass(frozen=True)
class MeshStatistics:
    """The mesh table, with the number of fixed nodes and cells.

    Attributes:
        parts: one row a part, soft tissue first.
        cells: number of tetrahedra.
        fixed: number of fixed nodes.
    """

    parts: tuple[PartStatistics, ...]
    cells: int
    fixed: int

    @property
    def points(self) -> int:
        """Nodes in all."""
        return sum(part.points for part in self.parts)

    @property
    def edges(self) -> int:
        """Directed edges in all."""
        return sum(part.edges for part in self.parts)

    def markdown(self) -> str:
        """The table in Markdown."""
        rows = [f"| {part.name} ({part.label}) | {part.points} | {part.edges} |" for part in self.parts]
        return "\n".join([
            "| Anatomy (label) | Mesh points | Mesh edges |", "| --- | ---: | ---: |", *rows,
            f"| Total | {self.points} | {self.edges} |", "", f"{self.cells} tetrahedra, {self.fixed} fixed nodes.", "",
        ])

    def table(self) -> Table:
        """The table for the terminal."""
        table = Table(title="Mesh", caption=f"{self.cells} tetrahedra, {self.fixed} fixed nodes")
        table.add_column("Anatomy (label)")
        table.add_column("Mesh points", justify="right")
        table.add_column("Mesh edges", justify="right")
        for part in self.parts:
            table.add_row(f"{part.name} ({part.label})", str(part.points), str(part.edges))
        table.add_section()
        table.add_row("Total", str(self.points), str(self.edges))
        return table


def mesh_statistics(mesh: TissueMesh) -> MeshStatistics:
    """Count points and directed edges of each part; an edge belongs to a rigid part if both its ends do."""
    points = np.bincount(mesh.part, minlength=mesh.n_parts + 1)
    edges = 2 * np.bincount(mesh.edge_part, minlength=mesh.n_parts + 1)
    names = ("soft tissue", *mesh.rigid_names)
    parts = tuple(
        PartStatistics(k, name, int(points[k]), int(edges[k])) for k, name in enumerate(names)
    )
    return MeshStatistics(parts, len(mesh.cells), int(mesh.fixed.sum()))
