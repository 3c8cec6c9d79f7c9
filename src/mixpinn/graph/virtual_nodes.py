"""Virtual nodes: one node at the centre of each rigid part, joined to all nodes of the part."""

from dataclasses import replace

import torch
from torch_geometric.transforms import BaseTransform

from mixpinn.base.errors import InputError
from mixpinn.graph.features import node_features
from mixpinn.graph.mesh_graph import MeshGraph


class VirtualNodes(BaseTransform):
    """Append one virtual node for each rigid part, as in the paper's section on graph augmentation.

    - initial displacement: zero (`node_input`);
    - rest position: mean position of the part's nodes;
    - rigid mask: the part's;
    - edges: to every node of the part, in both directions, with the length and the part as features;
    - output displacement: mean displacement of the part's nodes (`virtual_targets`).

    Parts without nodes get none.

    Raises:
        InputError: the graph has virtual nodes already.
    """

    def forward(self, graph: MeshGraph) -> MeshGraph:
        """`graph` with its virtual nodes and their edges appended."""
        if len(graph.virtual_node_part):
            raise InputError(
                "graph", expected="no virtual nodes yet", got=f"{len(graph.virtual_node_part)}",
                fix="apply VirtualNodes once",
            )
        members = {k: graph.part_nodes(k) for k in range(1, graph.n_parts + 1)}
        members = {k: nodes for k, nodes in members.items() if len(nodes)}
        if not members:
            return graph
        centres = torch.stack([graph.position[nodes].mean(dim=0) for nodes in members.values()])
        parts = torch.tensor(list(members), dtype=graph.part.dtype, device=graph.part.device)
        extended = replace(
            graph, position=torch.cat([graph.position, centres]), part=torch.cat([graph.part, parts]),
            node_features=torch.cat([graph.node_features, node_features(centres, parts, graph.n_parts)]),
            virtual_node_part=parts,
        )
        node = torch.cat(list(members.values()))
        hub = torch.cat([torch.full_like(nodes, graph.n_nodes + i) for i, nodes in enumerate(members.values())])
        return extended.with_edges(torch.cat([torch.stack([node, hub]), torch.stack([hub, node])], dim=1))
