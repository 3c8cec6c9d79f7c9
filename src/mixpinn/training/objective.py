"""What is trained, and towards what: a fresh network with its scaling, and the loss."""

import numpy as np
import torch
from torch import Tensor

from mixpinn.graph import MeshGraph
from mixpinn.networks import DisplacementModel, ModelConfig, build_model, mean_euclidean_error, rigid_edge_loss
from mixpinn.records import SampleTable

SCALING_SAMPLES = 128
"""Scaling statistics come from this many training samples, evenly spread: more would not change them visibly."""


def new_model(config: ModelConfig, graph: MeshGraph, table_train: SampleTable, *, seed: int) -> DisplacementModel:
    """A freshly initialised network whose scaling, where it has any, fits the training samples."""
    model = build_model(config, graph, seed=seed)
    some = np.unique(np.linspace(0, len(table_train) - 1, SCALING_SAMPLES).astype(np.int64))
    fields = np.array(table_train.displacement[some, : graph.n_mesh_nodes], dtype=np.float32)
    model.fit_scaling(torch.from_numpy(fields))
    return model


def training_loss(config: ModelConfig, graph: MeshGraph, predicted: Tensor, target: Tensor) -> Tensor:
    """L = L_MEE + w · L_REL, the loss of training and validation.

    L_MEE counts the virtual nodes with their own targets; L_REL has weight w = `config.rel_weight` and covers the
    rigid edges of the mesh and of virtual nodes and virtual edges.

    Args:
        config: its `rel_weight` is w.
        graph: the topology, on the device of the fields.
        predicted: displacement [mm], shape (B, N, 3).
        target: displacement of mesh and virtual nodes [mm], shape (B, N, 3).

    Returns:
        scalar, the mean over the batch.
    """
    loss = mean_euclidean_error(predicted, target)
    if config.rel_weight > 0.0:
        loss = loss + config.rel_weight * rigid_edge_loss(predicted, graph)
    return loss
