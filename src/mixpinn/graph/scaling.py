"""Scaling of what a network reads and answers: none (millimetres as in the paper's table), or standardised."""

from dataclasses import dataclass
from enum import StrEnum

import torch
from torch import Tensor

from mixpinn.graph.assembly import check_mesh_field
from mixpinn.graph.mesh_graph import MeshGraph


class Scaling(StrEnum):
    """How the inputs and outputs of a network are scaled."""

    NONE = "none"
    """As listed in the paper's table: mm and rad go in, mm come out."""
    STANDARD = "standard"
    """Rest positions standardised over the nodes, displacements in units of the training targets' rms."""


@dataclass(frozen=True, eq=False)
class ScalingStatistics:
    """A network reads (input − input_shift) / input_scale, and its output times output_scale is in mm.

    Attributes:
        input_shift, input_scale: of the node features, shape (9 + K,).
        edge_shift, edge_scale: of the edge features, shape (1 + K,).
        output_scale: of the displacement [mm], shape (3,).
    """

    input_shift: Tensor
    input_scale: Tensor
    edge_shift: Tensor
    edge_scale: Tensor
    output_scale: Tensor


def identity_statistics(graph: MeshGraph) -> ScalingStatistics:
    """Statistics that change nothing: `Scaling.NONE`."""
    n_inputs, n_edge_inputs = graph.n_inputs, graph.edge_features.shape[1]
    return ScalingStatistics(
        torch.zeros(n_inputs), torch.ones(n_inputs), torch.zeros(n_edge_inputs), torch.ones(n_edge_inputs),
        torch.ones(3),
    )


def standard_statistics(graph: MeshGraph, displacement: Tensor) -> ScalingStatistics:
    """Statistics of `Scaling.STANDARD` from the graph and the training targets.

    Displacements, contact displacement included, are divided by the root mean square of the targets' components and
    not shifted, so that zero stays zero; x, y, z, r, θ, φ and the edge length are standardised over the graph; one-hot
    columns stay as they are.

    Args:
        graph: the topology.
        displacement: training targets, or a fair share of them [mm], shape (S, n, 3).

    Raises:
        InputError: the field is not one of this graph's mesh.
    """
    check_mesh_field(graph, displacement, "displacement")
    rms = displacement.double().square().mean(dim=(0, 1)).sqrt().float()
    rms = torch.where(rms > 0.0, rms, torch.ones_like(rms))
    identity = identity_statistics(graph)
    input_shift, input_scale = identity.input_shift.clone(), identity.input_scale.clone()
    edge_shift, edge_scale = identity.edge_shift.clone(), identity.edge_scale.clone()
    geometry = graph.node_features[:, :6].double()
    input_scale[:3] = rms
    input_shift[3:9], input_scale[3:9] = geometry.mean(dim=0), _spread(geometry)
    length = graph.edge_length.double()[:, None]
    edge_shift[:1], edge_scale[:1] = length.mean(dim=0), _spread(length)
    return ScalingStatistics(input_shift, input_scale, edge_shift, edge_scale, rms)


def _spread(values: Tensor) -> Tensor:
    deviation = values.std(dim=0, correction=0)
    return torch.where(deviation > 0.0, deviation, torch.ones_like(deviation))
