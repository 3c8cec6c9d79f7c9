"""Diameter of rigid parts: how many layers a message needs to cross one."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.records import TissueMesh


def part_diameters(mesh: TissueMesh) -> dict[str, int]:
    """Edges between the two nodes of each rigid part that are farthest apart in the graph of the whole mesh, by name.

    A message travels one edge a layer and may take the short cut through the soft tissue, so that this, and not the
    diameter of the part's own graph (which is larger), is the number of layers without which one end of a part cannot
    hear of the other.
    """
    n = mesh.n_points
    edges = mesh.edges
    graph = csr_array((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(n, n))
    return {
        name: _longest(graph, np.flatnonzero(mesh.part == k)) for k, name in enumerate(mesh.rigid_names, start=1)
    }


def _longest(graph: csr_array, nodes: IntArray) -> int:
    if not len(nodes):
        return 0
    hops: FloatArray = shortest_path(graph, directed=False, unweighted=True, indices=nodes)[:, nodes]
    return int(hops.max())
