"""Flat ears: cells that lie on the skin with two faces, and what becomes of them under a probe."""

from dataclasses import replace

import numpy as np

from mixpinn.mesh.checks.quality import dihedral_angles
from mixpinn.records.tetrahedra import TETRA_FACES
from mixpinn.records.tissue_mesh import TissueMesh

FLAT = 140.0
"""Two faces of the skin that meet at more than this angle [degree] are about one plane."""


def peel_flat_ears(mesh: TissueMesh, *, flat: float = FLAT) -> TissueMesh:
    """Take the flat ears off the skin.

    An ear has two faces on the skin, so that all of its nodes are skin nodes; it is flat where these two faces meet at
    more than `flat` degrees. Its volume is then decided by the skin alone. A probe presses the skin to its own shape,
    and the height of a flat ear, a millimetre or two, is less than what that moves: the ear turns inside out. Without
    it the skin runs over its other two faces: an edge of the skin is flipped, no node is lost, and the skin moves by
    less than the ear's height.

    An ear stays where its removal would fold the skin, double one of its edges or free a node, and where a
    neighbouring cell was removed already. Ears of which a node is rigid stay as well.

    Args:
        mesh: with labels.
        flat: [degree].
    """
    faces = np.sort(mesh.cells[:, TETRA_FACES], axis=2).astype(np.int64)  # (m, 4, 3)
    skin = {tuple(face) for face in np.sort(mesh.skin_faces, axis=1).tolist()}
    edges = {edge for face in skin for edge in ((face[0], face[1]), (face[0], face[2]), (face[1], face[2]))}
    degree = np.bincount(mesh.boundary_faces.ravel(), minlength=mesh.n_points)
    cells_of = np.bincount(mesh.cells.ravel(), minlength=mesh.n_points)
    on_skin = np.zeros(mesh.n_points, dtype=bool)
    on_skin[np.unique(mesh.skin_faces)] = True
    first, second = np.triu_indices(4, 1)
    kept = np.ones(len(mesh.cells), dtype=bool)
    touched: set[tuple[int, ...]] = set()
    for cell in np.flatnonzero(on_skin[mesh.cells].all(axis=1)):
        sides = [tuple(face) for face in faces[cell].tolist()]
        outer = [k for k in range(4) if sides[k] in skin]
        if len(outer) != 2 or touched & set(sides):
            continue
        pair = int(np.flatnonzero((first == outer[0]) & (second == outer[1]))[0])
        if dihedral_angles(mesh.points, mesh.cells[[cell]])[0, pair] < flat:
            continue
        nodes = mesh.cells[cell]
        # Face k lies opposite node k: the outer faces share the edge of the other two nodes.
        ridge = [int(nodes[k]) for k in range(4) if k not in outer]
        flipped = (min(nodes[outer]), max(nodes[outer]))
        if flipped in edges or min(degree[ridge]) <= 3 or cells_of[nodes].min() < 2:
            continue
        kept[cell] = False
        touched |= set(sides)
        edges.add((int(flipped[0]), int(flipped[1])))
        edges.discard((min(ridge), max(ridge)))
        degree[ridge] -= 1
        degree[nodes[outer]] += 1
        cells_of[nodes] -= 1
    return mesh if kept.all() else replace(mesh, cells=mesh.cells[kept], tissue=mesh.tissue[kept])
