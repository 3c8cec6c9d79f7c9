"""Networks and their losses."""

from mixpinn.models.attention import Backend, GraphAttention
from mixpinn.models.checkpoint import (
    MESH_FILE,
    WEIGHTS_FILE,
    describe_training,
    load_checkpoint,
    model_name,
    read_description,
    save_checkpoint,
)
from mixpinn.models.config import ABLATION, MIXPINN, MODELS, PHYSGNN, SIMPLE_GAT, WIDTHS, ModelConfig
from mixpinn.models.displacement_model import DisplacementModel, build_graph_for, build_model, mesh_output
from mixpinn.models.fused_attention import fused_attention
from mixpinn.models.gat import GATNetwork
from mixpinn.models.losses import mean_euclidean_error, rigid_edge_error, rigid_edge_loss
from mixpinn.models.physgnn import PhysGNNNetwork
from mixpinn.models.tensor_file import read_tensors, write_tensors
from mixpinn.models.topology import AttentionTopology, build_topology

__all__ = [
    "ABLATION", "MESH_FILE", "MIXPINN", "MODELS", "PHYSGNN", "SIMPLE_GAT", "WEIGHTS_FILE", "WIDTHS",
    "AttentionTopology", "Backend", "DisplacementModel", "GATNetwork", "GraphAttention", "ModelConfig",
    "PhysGNNNetwork", "build_graph_for", "build_model", "build_topology", "describe_training", "fused_attention",
    "load_checkpoint", "mean_euclidean_error", "mesh_output", "model_name", "read_description", "read_tensors",
    "rigid_edge_error", "rigid_edge_loss", "save_checkpoint", "write_tensors",
]
