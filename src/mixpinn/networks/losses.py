"""Losses and the rigid edge error, on displacement fields."""

import torch
from torch import Tensor

from mixpinn.graph import MeshGraph


def safe_norm(vector: Tensor) -> Tensor:
    """Euclidean norm over the last axis whose gradient at zero is zero instead of undefined."""
    squared = vector.square().sum(dim=-1)
    zero = squared == 0.0
    return torch.where(zero, torch.zeros_like(squared), torch.where(zero, torch.ones_like(squared), squared).sqrt())


def mean_euclidean_error(predicted: Tensor, target: Tensor) -> Tensor:
    """L_MEE = 1/|V| Σᵢ √((xᵢ − x̂ᵢ)² + (yᵢ − ŷᵢ)² + (zᵢ − ẑᵢ)²), the paper's main loss, averaged over the batch.

    Args:
        predicted: displacement [mm], shape (B, N, 3).
        target: displacement [mm], shape (B, N, 3).

    Returns:
        scalar [mm].
    """
    return safe_norm(predicted - target).mean()


def edge_length_change(displacement: Tensor, position: Tensor, edges: Tensor) -> Tensor:
    """l̂ − l of each edge [mm].

    Args:
        displacement: [mm], shape (B, N, 3).
        position: rest positions [mm], shape (N, 3).
        edges: shape (2, R).

    Returns:
        shape (B, R), in the precision of `displacement`.
    """
    source, target = edges
    rest = (position[target] - position[source]).to(displacement)
    change = displacement[:, target] - displacement[:, source]
    length, moved = safe_norm(rest), safe_norm(rest + change)
    # |r + u| − |r| = (2 r + u) · u / (|r + u| + |r|): no difference of nearly equal lengths in float32.
    total = moved + length
    return ((2.0 * rest + change) * change).sum(dim=-1) / torch.where(total > 0.0, total, torch.ones_like(total))


def rigid_edge_loss(displacement: Tensor, graph: MeshGraph) -> Tensor:
    """L_REL = 1/|E_rigid| Σ (l − l̂)² over all rigid edges of the graph, virtual ones included [mm²].

    Args:
        displacement: of all nodes [mm], shape (B, N, 3).
        graph: the topology.

    Returns:
        scalar, averaged over the batch; zero for a graph without rigid edges.
    """
    return _mean(edge_length_change(displacement, graph.position, graph.rigid_edges).square())


def rigid_edge_change(displacement: Tensor, graph: MeshGraph, *, virtual: bool = False) -> Tensor:
    """Mean absolute change of length over the rigid edges, in float64.

    Args:
        displacement: of the mesh nodes, shape (B, n, 3), or, with `virtual`, of all nodes [mm], shape (B, N, 3).
        graph: the topology.
        virtual: whether virtual edges and those of virtual nodes count as well.

    Returns:
        of each sample [mm], float64, shape (B,); zero for a graph without rigid edges.
    """
    edges = graph.rigid_edges if virtual else graph.mesh_rigid_edges
    if edges.shape[1] == 0:
        return displacement.new_zeros(len(displacement), dtype=torch.float64)
    return edge_length_change(displacement.double(), graph.position, edges).abs().mean(dim=1)


def _mean(values: Tensor) -> Tensor:
    return values.mean() if values.numel() else values.sum()
