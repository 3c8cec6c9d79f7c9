"""Rigid bodies: how they carry their nodes, and the forces and motions about their centroids."""

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray


def geometric_stiffness(arms: FloatArray, forces: FloatArray) -> FloatArray:
    """Second derivative of Σ_r g_r · exp([w]) d_r with respect to w at w = 0, g_r held constant.

    exp([w]) d = d + w × d + ½ w × (w × d) + …, hence for directions a, b
    D²[a, b] = ½ ([a][b] + [b][a]) d = ½ (a (b·d) + b (a·d)) − d (a·b), and summed with g
    the symmetric matrix Σ_r ½ (d gᵀ + g dᵀ) − (g·d) 1.

    Args:
        arms: d_r, node less current centroid [mm], shape (n, 3).
        forces: g_r, gradient of the energy at the node [N], shape (n, 3).

    Returns:
        [N mm], shape (3, 3).
    """
    product = arms.T @ forces
    stiffness: FloatArray = 0.5 * (product + product.T) - np.trace(product) * np.eye(3)
    return stiffness


class RigidParts:
    """The rigid parts of a mesh: which nodes they carry, and forces and motions about their centroids.

    The reference point of a part is its centroid, the mean of its vertices; an arm d is a node's current position less
    the current centroid. Midpoints of edges follow the part and do not shift the centroid, so that motions of linear
    and quadratic cells on one mesh refer to the same point.

    Args:
        points: rest positions of all nodes [mm], shape (n, 3).
        part: per node 0 or its part 1 … K, shape (n,).
        n_parts: K; each part has at least one vertex.
        n_vertices: the first so many nodes are vertices; by default all.
    """

    def __init__(self, points: FloatArray, part: AnyArray, n_parts: int, *, n_vertices: int | None = None) -> None:
        self._rest = points
        self.by_part: list[IntArray] = [np.flatnonzero(part == k) for k in range(1, n_parts + 1)]
        self.nodes: IntArray = np.concatenate([*self.by_part, np.empty(0, dtype=np.int64)])
        self.centroids: FloatArray = np.array([
            points[np.flatnonzero(part[:n_vertices] == k)].mean(axis=0) for k in range(1, n_parts + 1)
        ]).reshape(-1, 3)

    def __len__(self) -> int:
        return len(self.by_part)

    def place(self, points: FloatArray, rotation: FloatArray, translation: FloatArray) -> None:
        """Put the nodes of each part at c + t + R (X − c), in place.

        Args:
            points: positions of all nodes [mm], shape (n, 3).
            rotation: R of each part, shape (K, 3, 3).
            translation: displacement t of each centroid [mm], shape (K, 3).
        """
        for nodes, centre, turn, shift in zip(self.by_part, self.centroids, rotation, translation, strict=True):
            points[nodes] = (self._rest[nodes] - centre) @ turn.T + (centre + shift)

    def arms(self, points: FloatArray, translation: FloatArray) -> FloatArray:
        """Arm of each node of a part [mm], zero for the other nodes; shape (n, 3)."""
        arms = np.zeros_like(points)
        for nodes, centre in zip(self.by_part, self.centroids + translation, strict=True):
            arms[nodes] = points[nodes] - centre
        return arms

    def wrench(self, nodal: FloatArray, points: FloatArray, translation: FloatArray) -> FloatArray:
        """Net force and moment about the current centroid of nodal forces (n, 3); shape (K, 6) [N, N mm]."""
        wrench = np.empty((len(self), 6))
        for k, (nodes, centre) in enumerate(zip(self.by_part, self.centroids + translation, strict=True)):
            wrench[k, :3] = nodal[nodes].sum(axis=0)
            wrench[k, 3:] = np.cross(points[nodes] - centre, nodal[nodes]).sum(axis=0)
        return wrench

    def expand(self, twist: FloatArray, arms: FloatArray, out: FloatArray) -> None:
        """Linearised displacement δt + δw × d of each part's nodes for twists (K, 6) [mm, rad] into `out` (n, 3)."""
        for nodes, motion in zip(self.by_part, twist, strict=True):
            out[nodes] = motion[:3] + np.cross(motion[3:], arms[nodes])
