"""What every mesher offers, and the criteria it works to."""

import importlib.util
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import sparse

from mixpinn.base.arrays import AnyArray, FloatArray, Int32Array
from mixpinn.base.errors import InputError
from mixpinn.base.sensible import positive, require_settings
from mixpinn.mesh.cells.orientation import check_cells, flat_cells, orient_cells
from mixpinn.mesh.meshers.grading import Grading
from mixpinn.mesh.surfaces.surface import DomainSurfaces


@dataclass(frozen=True)
class Sizing:
    """Criteria of a Delaunay mesher, named as in CGAL; the defaults are the paper's.

    Attributes:
        cell_ratio: largest ratio of a cell's circumradius to its shortest edge.
        cell_size: largest circumradius of a cell [mm].
        facet_angle: smallest angle of a surface triangle [degree].
        facet_size: largest radius of the ball round a surface triangle, centred on the surface [mm].
        facet_approximation: largest distance of a surface triangle's centre from the surface [mm].
    """

    cell_ratio: float = 2.0
    cell_size: float = 40.0
    facet_angle: float = 30.0
    facet_size: float = 30.0
    facet_approximation: float = 1.0

    def __post_init__(self) -> None:
        require_settings(self, "sizing", positive(
            self, "cell_ratio", "cell_size", "facet_angle", "facet_size", "facet_approximation",
        ))

    def scaled(self, size: float) -> "Sizing":
        """The criteria with all lengths multiplied by `size`: above 1 coarser, below 1 finer.

        Raises:
            InputError: `size` is not positive.
        """
        if not size > 0.0:
            raise InputError(
                "size", expected="a positive factor", got=f"{size:g}", fix="1 is the paper's mesh, 2 is coarser",
            )
        return Sizing(
            self.cell_ratio, self.cell_size * size, self.facet_angle, self.facet_size * size,
            self.facet_approximation * size,
        )


PAPER_SIZING = Sizing()
"""cellRatio 2, cellSize 40, facetAngle 30, facetSize 30, facetApproximation 1: the paper's preset."""


class Mesher(Protocol):
    """Fills the space between the body's surface and the cavities with tetrahedra."""

    @property
    def name(self) -> str:
        """How the mesher is called."""
        ...

    def fill(self, surfaces: DomainSurfaces, sizing: Sizing | Grading) -> tuple[FloatArray, Int32Array]:
        """Points [mm] (n, 3) and positively oriented cells (m, 4) of the soft tissue.

        Raises:
            InputError: the surfaces cannot be meshed, or the mesher is not installed.
        """
        ...


def has_cgal() -> bool:
    """Whether the optional CGAL bindings are installed."""
    return importlib.util.find_spec("CGAL") is not None


def tidy(points: AnyArray, cells: AnyArray, *, what: str) -> tuple[FloatArray, Int32Array]:
    """Oriented cells of the largest connected piece, without flat cells and loose points.

    Raises:
        InputError: no cells remain, or they overlap.
    """
    points = np.asarray(points, dtype=np.float64)
    if len(cells):
        cells = np.delete(cells, flat_cells(points, cells), axis=0)
    if not len(cells):
        raise InputError(
            what, expected="surfaces that enclose a volume the mesher can fill", got="no tetrahedra",
            fix="choose a smaller size or check the surfaces",
        )
    cells = _largest_piece(np.asarray(cells, dtype=np.int64), len(points))
    used, inverse = np.unique(cells, return_inverse=True)
    points, oriented = points[used], orient_cells(points[used], inverse.reshape(-1, 4))
    check_cells(points, oriented, what=what)
    return points, oriented


def _largest_piece(cells: AnyArray, n_points: int) -> AnyArray:
    ends = np.concatenate([cells[:, [0, j]] for j in (1, 2, 3)])
    links = sparse.coo_matrix((np.ones(len(ends), dtype=np.int8), ends.T), shape=(n_points, n_points))
    _, piece = sparse.csgraph.connected_components(links, directed=False)
    of_cell = piece[cells[:, 0]]
    largest: AnyArray = cells[of_cell == np.bincount(of_cell).argmax()]
    return largest
