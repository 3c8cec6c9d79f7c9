"""What the middle of an edge belongs to: the rule for mid-edge nodes and for the nodes of a refined mesh."""

from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray

if TYPE_CHECKING:
    from mixpinn.records.tissue_mesh import TissueMesh


def mid_edge_labels(mesh: "TissueMesh") -> tuple[AnyArray, BoolArray]:
    """Part and fixity of a node in the middle of each of `mesh.edges`.

    An edge from one wall of a rigid part to another of its walls runs through tissue, and its middle is soft though
    both ends are rigid. The middle belongs to a part only where the edge lies on that part's surface: where it is
    the side of a boundary face whose three nodes are the part's. Likewise it is fixed only where the edge is the side
    of a skin face and both of its ends are fixed; that of a part's is held where the part is.

    Returns:
        Part of each middle, int16, shape (e,), and whether it is fixed, bool, shape (e,); rows as in `mesh.edges`.
    """
    part = np.zeros(len(mesh.edges), dtype=np.int16)
    faces = mesh.boundary_faces
    of_node = mesh.part[faces]
    wall = faces[(of_node > 0).all(axis=1) & (of_node == of_node[:, :1]).all(axis=1)]
    sides = edge_index(mesh, _sides(wall))
    part[sides] = np.repeat(mesh.part[wall[:, :1]], 3, axis=1).T.ravel()
    fixed = np.zeros(len(mesh.edges), dtype=bool)
    fixed[edge_index(mesh, _sides(mesh.skin_faces))] = True
    fixed &= mesh.fixed[mesh.edges].all(axis=1)
    held = [k for k in np.unique(part[part > 0]) if mesh.fixed[mesh.part == k].all()]
    fixed |= np.isin(part, held)
    return part, fixed


def edge_index(mesh: "TissueMesh", pairs: AnyArray) -> AnyArray:
    """Row in `mesh.edges` of each pair of nodes, in either order, shape (q,); the pairs must be edges."""
    ends = np.sort(np.asarray(pairs, dtype=np.int64), axis=-1)
    keys = mesh.edges[:, 0] * mesh.n_points + mesh.edges[:, 1]
    rows: AnyArray = np.searchsorted(keys, ends[..., 0] * mesh.n_points + ends[..., 1])
    return rows


def _sides(faces: AnyArray) -> AnyArray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
