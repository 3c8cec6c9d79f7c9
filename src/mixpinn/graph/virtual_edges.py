"""Virtual edges: a reference node of each rigid part joined to all other nodes of the part."""

import numpy as np
import torch
from torch import Tensor
from torch_geometric.transforms import BaseTransform

from mixpinn.graph.mesh_graph import MeshGraph


def reference_node(graph: MeshGraph, k: int) -> int:
    """Mesh node of rigid part k that lies nearest the back, i.e. with the largest y.

    Among equals the one with the larger x, then z, so that the numbering of the nodes does not matter.
    """
    nodes = graph.part_nodes(k).cpu().numpy()
    x, y, z = graph.position[nodes].cpu().numpy().T
    return int(nodes[np.lexsort((z, x, y))[-1]])


class VirtualEdges(BaseTransform):
    """Join the reference node of each rigid part to every other mesh node of the part, in both directions.

    The reference node is static: the one nearest the probed back (`reference_node`). Where an edge exists already
    none is added. The new edges have the length and the part as features, like all others.
    """

    def forward(self, graph: MeshGraph) -> MeshGraph:
        """`graph` with the virtual edges appended."""
        added: list[Tensor] = []
        source, target = graph.edge_index
        for k in range(1, graph.n_parts + 1):
            nodes = graph.part_nodes(k)
            if len(nodes) < 2:
                continue
            hub = reference_node(graph, k)
            joined = torch.cat([source[target == hub], torch.tensor([hub], device=source.device)])
            others = nodes[~torch.isin(nodes, joined)]
            hubs = torch.full_like(others, hub)
            added += [torch.stack([others, hubs]), torch.stack([hubs, others])]
        return graph.with_edges(torch.cat(added, dim=1)) if added else graph
