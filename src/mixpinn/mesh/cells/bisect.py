"""Local refinement: cells are halved until no edge is longer than it may be; the facets stay."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray
from mixpinn.records.mid_edges import edge_index, mid_edge_labels
from mixpinn.records.tissue_mesh import TissueMesh

_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
_TOLERANCE = 1e-9
"""Edges whose lengths differ by less than this share count as equally long; then the later row is the longer."""

_RINGS = 2
"""Of cells around the wanted edges that are looked at first, and each time that a cut has reached their border."""


def refine_to(mesh: TissueMesh, length: Callable[[FloatArray], FloatArray]) -> TissueMesh:
    """Halve edges longer than `length` at their middle, by bisection along the longest edges.

    A cell is only ever cut through the middle of its longest edge. An edge is cut once it is the longest of all cells
    around it; where a cell has a longer one, that one is cut first. So the mesh stays conforming, and as the longest
    wanted edge of all can always be cut, the process ends. Every new node on the boundary lies in the plane of an old
    facet: the geometry is the same. Labels follow `mid_edge_labels`, a cell keeps its parent's tissue.

    Args:
        mesh: with n nodes, which keep their numbers.
        length: largest edge length wanted [mm] (q,) at points [mm] (q, 3).
    """
    wanted = mesh.edges[_squared_lengths(mesh) > length(mesh.points[mesh.edges].mean(axis=1)) ** 2]
    if not len(wanted):
        return mesh
    near = np.zeros(mesh.n_points, dtype=bool)
    near[wanted] = True
    while True:  # cuts seldom spread far: only cells around the wanted edges are looked at
        for _ in range(_RINGS):
            near[mesh.cells[near[mesh.cells].any(axis=1)]] = True
        chosen = near[mesh.cells].any(axis=1)
        some = _refine_all(replace(mesh, cells=mesh.cells[chosen], tissue=mesh.tissue[chosen]), length)
        border = np.intersect1d(_edge_keys(mesh.cells[chosen]), _edge_keys(mesh.cells[~chosen]), assume_unique=True)
        if np.isin(border, _edge_keys(some.cells), assume_unique=True).all():
            break
    own, cells, tissue = int(chosen.sum()), mesh.cells.copy(), mesh.tissue.copy()
    cells[chosen], tissue[chosen] = some.cells[:own], some.tissue[:own]
    return replace(
        some, cells=np.concatenate([cells, some.cells[own:]]), tissue=np.concatenate([tissue, some.tissue[own:]]),
    )


def _refine_all(mesh: TissueMesh, length: Callable[[FloatArray], FloatArray]) -> TissueMesh:
    """`refine_to` on all cells of a mesh that need not have all points in cells; a cell's first half keeps its row."""
    known, lengths = np.zeros(0, dtype=np.int64), np.zeros(0)  # by the ends of the edge: a field may be dear
    while True:
        edges = mesh.edges
        keys = _keys(edges)
        before = np.minimum(np.searchsorted(known, keys), len(known) - 1)  # both ascend
        new = known[before] != keys if len(known) else np.ones(len(edges), dtype=bool)
        allowed = np.empty(len(edges))
        allowed[~new] = lengths[before[~new]]
        allowed[new] = length(mesh.points[edges[new]].mean(axis=1))
        known, lengths = keys, allowed
        of_cell = edge_index(mesh, mesh.cells[:, _EDGES])
        squared = _squared_lengths(mesh)
        rank = np.empty(len(edges), dtype=np.int64)
        rank[np.argsort(_levels(squared), kind="stable")] = np.arange(len(edges))
        longest = of_cell[np.arange(len(of_cell)), rank[of_cell].argmax(axis=1)]
        wanted = squared > allowed**2
        if not wanted.any():
            return mesh
        wanted = _with_longer(wanted, of_cell, longest)
        shared = np.bincount(of_cell.ravel(), minlength=len(edges))
        cut = wanted & (np.bincount(longest, minlength=len(edges)) == shared)
        mesh = _halve(mesh, of_cell, longest, cut)


def _squared_lengths(mesh: TissueMesh) -> FloatArray:
    lengths: FloatArray = ((mesh.points[mesh.edges[:, 0]] - mesh.points[mesh.edges[:, 1]]) ** 2).sum(axis=1)
    return lengths


def _keys(edges: AnyArray) -> AnyArray:
    """One number for each edge (e, 2), whatever the mesh that it is of."""
    keys: AnyArray = (edges[:, 0].astype(np.int64) << 32) + edges[:, 1]
    return keys


def _edge_keys(cells: AnyArray) -> AnyArray:
    """Keys of the edges of some cells, each once, ascending."""
    return np.unique(_keys(np.sort(cells[:, _EDGES].reshape(-1, 2), axis=1)))


def _levels(squared: FloatArray) -> AnyArray:
    """Lengths on a logarithmic scale, rounded, so that equal ones are told apart by their row alone."""
    levels: AnyArray = np.rint(np.log(squared) / (2.0 * _TOLERANCE)).astype(np.int64)
    return levels


def _with_longer(wanted: BoolArray, of_cell: AnyArray, longest: AnyArray) -> BoolArray:
    """`wanted` and the longest edge of every cell that has a wanted edge, and so on until nothing is added."""
    while True:
        touched = longest[wanted[of_cell].any(axis=1)]
        if wanted[touched].all():
            return wanted
        wanted = wanted.copy()
        wanted[touched] = True


def _labels(mesh: TissueMesh, cut: BoolArray) -> tuple[AnyArray, BoolArray]:
    """`mid_edge_labels`, as far as the edges `cut` are concerned; most have no end that lends them a label."""
    ends = mesh.edges[cut]
    part = mesh.part[ends]
    if ((part[:, 0] > 0) & (part[:, 0] == part[:, 1])).any() or mesh.fixed[ends].all(axis=1).any():
        return mid_edge_labels(mesh)
    return np.zeros(len(mesh.edges), dtype=np.int16), np.zeros(len(mesh.edges), dtype=bool)


def _halve(mesh: TissueMesh, of_cell: AnyArray, longest: AnyArray, cut: BoolArray) -> TissueMesh:
    """Cut the cells round the edges `cut`, no two of which share a cell, through the middles of these edges."""
    part, fixed = _labels(mesh, cut)
    middle = np.full(len(mesh.edges), -1)
    middle[cut] = mesh.n_points + np.arange(int(cut.sum()))
    parent = np.flatnonzero(cut[longest])
    pair = _EDGES[(of_cell[parent] == longest[parent, None]).argmax(axis=1)]
    first, second = mesh.cells[parent].copy(), mesh.cells[parent].copy()
    rows = np.arange(len(parent))
    first[rows, pair[:, 0]] = second[rows, pair[:, 1]] = middle[longest[parent]]
    cells = mesh.cells.copy()
    cells[parent] = first
    return replace(
        mesh, points=np.concatenate([mesh.points, mesh.points[mesh.edges[cut]].mean(axis=1)]),
        cells=np.concatenate([cells, second]).astype(np.int32), part=np.concatenate([mesh.part, part[cut]]),
        fixed=np.concatenate([mesh.fixed, fixed[cut]]), tissue=np.concatenate([mesh.tissue, mesh.tissue[parent]]),
    )
