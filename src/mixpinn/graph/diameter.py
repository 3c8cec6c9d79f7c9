"""How far messages travel: layers needed to cross a rigid part, and nodes that they reach from the contact."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra, shortest_path

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.records import SampleTable, TissueMesh


def part_diameters(mesh: TissueMesh) -> dict[str, int]:
    """Edges between the two nodes of each rigid part that are farthest apart in the graph of the whole mesh, by name.

    A message travels one edge a layer and may take the short cut through the soft tissue, so that this, and not the
    diameter of the part's own graph (which is larger), is the number of layers without which one end of a part cannot
    hear of the other.
    """
    graph = _graph(mesh)
    return {
        name: _longest(graph, np.flatnonzero(mesh.part == k)) for k, name in enumerate(mesh.rigid_names, start=1)
    }


def rigid_reach(mesh: TissueMesh, table: SampleTable, layers: int) -> float:
    """Share of the rigid nodes that `layers` layers join with a contact node, mean over the samples of `table`.

    The others cannot hear of the contact, and a network without virtual nodes or edges can only say what their mean is.
    """
    graph, rigid = _graph(mesh), np.flatnonzero(mesh.part > 0)
    shares = []
    for index in range(len(table)):
        hops: FloatArray = dijkstra(
            graph, directed=False, unweighted=True, indices=table.contacts(index), min_only=True, limit=layers,
        )
        shares.append(float((hops[rigid] <= layers).mean()))
    return float(np.mean(shares))


def _graph(mesh: TissueMesh) -> csr_array:
    n, edges = mesh.n_points, mesh.edges
    return csr_array((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(n, n))


def _longest(graph: csr_array, nodes: IntArray) -> int:
    if not len(nodes):
        return 0
    hops: FloatArray = shortest_path(graph, directed=False, unweighted=True, indices=nodes)[:, nodes]
    return int(hops.max())
