"""What a network reads and answers on a graph, from fields on the mesh."""

import torch
from torch import Tensor

from mixpinn.base.errors import InputError
from mixpinn.graph.mesh_graph import MeshGraph


def check_mesh_field(graph: MeshGraph, field: Tensor, name: str) -> None:
    """Raise `InputError` unless `field` has shape (B, n, 3) for the n mesh nodes of `graph`."""
    if field.dim() != 3 or tuple(field.shape[1:]) != (graph.n_mesh_nodes, 3):
        raise InputError(
            name, expected=f"shape (B, {graph.n_mesh_nodes}, 3)", got=str(tuple(field.shape)),
            fix="use data of the mesh that the graph was built from",
        )


def append_virtual_zeros(graph: MeshGraph, field: Tensor) -> Tensor:
    """`field` on the mesh nodes, shape (B, n, 3), with zeros for the virtual nodes, shape (B, N, 3)."""
    return torch.nn.functional.pad(field, (0, 0, 0, graph.n_nodes - graph.n_mesh_nodes))


def node_input(graph: MeshGraph, contact_displacement: Tensor) -> Tensor:
    """The input X of the paper's table: δx, δy, δz of the contact nodes, then the static node features.

    Args:
        graph: the topology.
        contact_displacement: displacement of the contact nodes, zero elsewhere [mm], shape (B, n, 3).

    Returns:
        shape (B, N, 9 + K); virtual nodes have zero contact displacement.

    Raises:
        InputError: the field is not one of this graph's mesh.
    """
    check_mesh_field(graph, contact_displacement, "contact displacement")
    contact = append_virtual_zeros(graph, contact_displacement)
    static = graph.node_features.to(contact).expand(len(contact), -1, -1)
    return torch.cat([contact, static], dim=2)


def virtual_targets(graph: MeshGraph, displacement: Tensor) -> Tensor:
    """The targets of all nodes: a virtual node's is the mean displacement of its part's nodes.

    Args:
        graph: the topology.
        displacement: of every mesh node [mm], shape (B, n, 3).

    Returns:
        displacement [mm], shape (B, N, 3).

    Raises:
        InputError: the field is not one of this graph's mesh.
    """
    check_mesh_field(graph, displacement, "displacement")
    means = [displacement[:, graph.part_nodes(int(k))].mean(dim=1, keepdim=True) for k in graph.virtual_node_part]
    return torch.cat([displacement, *means], dim=1)
