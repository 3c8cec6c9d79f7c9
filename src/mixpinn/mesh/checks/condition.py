"""What is odd about a ready mesh before it is simulated: its unit, its pieces, its parts, what holds it."""

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mixpinn.anatomy.names import spine_rank
from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records.tissue_mesh import TissueMesh

_IN_FRONT = 0.4
"""Share of the way from front to back that no spine lies in front of."""
_METRES, _CENTIMETRES, _LARGEST = 5.0, 60.0, 5000.0
"""Bodies less long than the first [mm] are none; less long than the second they may be in centimetres."""

_FEWEST = 8
"""Fixed nodes from which on a list of them may show how it was counted."""


def check_unit(mesh: TissueMesh, *, what: str) -> None:
    """Refuse a mesh whose lengths cannot be millimetres.

    Raises:
        InputError: it is smaller than 5 mm or larger than 5 m.
    """
    extent = float(np.ptp(mesh.points, axis=0).max())
    if _METRES <= extent <= _LARGEST:
        return
    unit = "metres" if extent < _METRES else "micrometres"
    raise InputError(
        what, expected="lengths in mm", got=f"a mesh {extent:.3g} mm long: they look like {unit}",
        fix=f"multiply its points by {'1000' if extent < _METRES else '0.001'}",
    )


def mesh_warnings(mesh: TissueMesh) -> tuple[str, ...]:
    """What a user should know before simulating, a line each."""
    return tuple(_warnings(mesh))


def _warnings(mesh: TissueMesh) -> Iterator[str]:
    extent = float(np.ptp(mesh.points, axis=0).max())
    if extent < _CENTIMETRES:
        yield f"the mesh is {extent:.3g} mm long: are its lengths centimetres?"
    piece = _pieces(mesh)
    count = int(piece.max()) + 1
    if count > 1:
        sizes = np.bincount(piece)
        free = [k for k in range(count) if not mesh.fixed[piece == k].any()]
        largest = ", ".join(map(str, sorted(sizes, reverse=True)[:5]))
        detail = f"{count} pieces that are not connected, of {largest} nodes"
        yield detail + (f"; {len(free)} of them without a fixed node" if free else "")
    doubled = mesh.n_points - len(np.unique(np.round(mesh.points, 6), axis=0))
    if doubled:
        yield f"{doubled} points lie at the place of another: surfaces that should be joined are not"
    if not mesh.fixed.any():
        yield "no node is fixed: nothing holds the body while the probe presses"
    elif not _spans(mesh.points[mesh.fixed]):
        yield f"the {int(mesh.fixed.sum())} fixed nodes lie at one place or on one line: the body can turn about them"
    if mesh.fixed[mesh.part == 0].all():
        soft = bool((mesh.part == 0).any())
        yield "every soft node is fixed: nothing can move" if soft else "every node is rigid: no soft tissue is left"
    if not mesh.rigid_names:
        yield "no rigid part: all of it is soft tissue"


def numbering_warnings(mesh: TissueMesh) -> tuple[str, ...]:
    """What says that a list of fixed nodes was counted from 1, a line at most.

    Such a list holds the node after each that was meant. So either nodes inside the body are held and the ones before
    them all lie on the skin, or the held nodes are strewn about and the ones before them are neighbours. The nodes are
    counted among all or among the soft ones, as lists are.
    """
    soft = np.flatnonzero(mesh.part == 0)
    return next((found for nodes in (np.arange(mesh.n_points), soft) if (found := _numbering(mesh, nodes))), ())


def _numbering(mesh: TissueMesh, nodes: IntArray) -> tuple[str, ...]:
    held = mesh.fixed[nodes]
    count = int(held.sum())
    if held[0] or count < _FEWEST:
        return ()
    meant = np.zeros(mesh.n_points, dtype=bool)
    meant[nodes[:-1]] = held[1:]
    skin = np.zeros(mesh.n_points, dtype=bool)
    skin[mesh.skin_faces] = True
    inside = int((mesh.fixed & ~skin).sum())
    if 4 * inside >= count and skin[meant].all():
        sign = f"{inside} of the {count} fixed nodes lie inside the body, the ones before them all on its skin"
    else:
        joined, before = (int(mask[mesh.edges].all(axis=1).sum()) for mask in (mesh.fixed, meant))
        if before <= max(2 * joined, count):
            return ()
        sign = f"{joined} edges join the {count} fixed nodes, {before} the ones before them"
    return (f"{sign}: is the list counted from 1? Nodes count from 0",)


def frame_warnings(mesh: TissueMesh) -> tuple[str, ...]:
    """What says that a mesh is not in the world frame (x right, y posterior, z caudal), a line each."""
    return tuple(_frame_warnings(mesh))


def _frame_warnings(mesh: TissueMesh) -> Iterator[str]:
    spine = [
        (rank, mesh.points[mesh.part == k].mean(axis=0)) for k, name in enumerate(mesh.rigid_names, start=1)
        if (rank := spine_rank(name)) is not None
    ]
    if len(spine) > 1 and min(spine, key=_rank)[1][2] > max(spine, key=_rank)[1][2]:
        yield "the vertebrae follow each other from the feet up: z does not run from head to feet"
    if not mesh.rigid_names:
        return
    rigid = mesh.points[mesh.part > 0]
    beside = mesh.points[(mesh.points[:, 2] >= rigid[:, 2].min()) & (mesh.points[:, 2] <= rigid[:, 2].max())]
    low, high = beside[:, 1].min(), beside[:, 1].max()
    share = (rigid[:, 1].mean() - low) / max(high - low, 1e-9)
    if share < _IN_FRONT:
        yield (
            f"the rigid parts lie in front of the body's middle, {share:.0%} of the way from front to back: "
            "y does not run from front to back, or the probe presses on the belly"
        )


def _rank(entry: tuple[int, FloatArray]) -> int:
    return entry[0]


def _spans(points: FloatArray) -> bool:
    """Whether points hold a body: three of them that are not on one line."""
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1e-3 * max(spread[0], 1e-9))


def _pieces(mesh: TissueMesh) -> IntArray:
    """Number of the piece that each node belongs to; rigid parts hold theirs together."""
    edges = np.concatenate([mesh.cells[:, [0, k]] for k in (1, 2, 3)])
    for part in range(1, len(mesh.rigid_names) + 1):
        nodes = np.flatnonzero(mesh.part == part)
        edges = np.concatenate([edges, np.column_stack([nodes[:-1], nodes[1:]])])
    ones = np.ones(len(edges))
    graph = coo_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(mesh.n_points, mesh.n_points))
    labels: IntArray = connected_components(graph, directed=False)[1]
    return labels
