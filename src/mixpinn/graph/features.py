"""Static node and edge features: the paper's table of inputs without the contact displacement."""

import torch
from torch import Tensor


def one_hot_part(part: Tensor, n_parts: int) -> Tensor:
    """Rigid mask m ∈ {0, 1}^K: column k − 1 is set for part k, none for soft tissue (part 0); shape (…, K)."""
    return (part[..., None] == torch.arange(1, n_parts + 1, device=part.device)).to(torch.float32)


def node_features(position: Tensor, part: Tensor, n_parts: int) -> Tensor:
    """Static features of the nodes: x, y, z, r, θ, φ, m.

    θ = atan2(y, x) and φ = acos(z / r) [rad]; both are 0 at the origin, where they have no meaning.

    Args:
        position: rest positions [mm], shape (N, 3).
        part: 0 for soft tissue or k = 1 … K, shape (N,).
        n_parts: number of rigid parts K.

    Returns:
        float32, shape (N, 6 + K).
    """
    x, y, z = position.to(torch.float64).unbind(dim=1)
    r = torch.sqrt(x * x + y * y + z * z)
    theta = torch.atan2(y, x)
    at_origin = r == 0.0
    cosine = torch.where(at_origin, 1.0, z / torch.where(at_origin, 1.0, r))
    phi = torch.acos(cosine.clamp(-1.0, 1.0))
    spherical = torch.stack([x, y, z, r, theta, phi], dim=1).to(torch.float32)
    return torch.cat([spherical, one_hot_part(part, n_parts)], dim=1)


def edge_part(part: Tensor, edge_index: Tensor) -> Tensor:
    """Part of each edge: k where both ends belong to rigid part k, else 0; shape (E,)."""
    source, target = part[edge_index]
    return torch.where(source == target, source, torch.zeros_like(source))


def edge_features(position: Tensor, part: Tensor, edge_index: Tensor, n_parts: int) -> Tensor:
    """Features of the edges: l, mₑ.

    Args:
        position: rest positions [mm], shape (N, 3).
        part: 0 for soft tissue or k = 1 … K, shape (N,).
        edge_index: source and target of each directed edge, shape (2, E).
        n_parts: number of rigid parts K.

    Returns:
        length [mm] and one-hot part by the both-ends rule, float32, shape (E, 1 + K).
    """
    source, target = edge_index
    length = torch.linalg.vector_norm(position[target].double() - position[source].double(), dim=1, keepdim=True)
    return torch.cat([length.to(torch.float32), one_hot_part(edge_part(part, edge_index), n_parts)], dim=1)
