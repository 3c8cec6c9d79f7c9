"""Networks and their losses."""

from mixpinn.networks.attention import Backend, GraphAttention
from mixpinn.networks.checkpoint import (
    WEIGHTS_FILE,
    describe_training,
    load_checkpoint,
    load_network_mesh,
    model_name,
    read_description,
    save_checkpoint,
)
from mixpinn.networks.config import ABLATION, MIXPINN, MODELS, PHYSGNN, SIMPLE_GAT, WIDTHS, ModelConfig
from mixpinn.networks.displacement_model import DisplacementModel, build_graph_for, build_model, mesh_output
from mixpinn.networks.fused_attention import fused_attention
from mixpinn.networks.gat import GATNetwork
from mixpinn.networks.losses import mean_euclidean_error, rigid_edge_change, rigid_edge_loss
from mixpinn.networks.physgnn import PhysGNNNetwork
from mixpinn.networks.tensor_file import read_tensors, write_tensors
from mixpinn.networks.topology import AttentionTopology, build_topology

__all__ = [
    "ABLATION", "MIXPINN", "MODELS", "PHYSGNN", "SIMPLE_GAT", "WEIGHTS_FILE", "WIDTHS",
    "AttentionTopology", "Backend", "DisplacementModel", "GATNetwork", "GraphAttention", "ModelConfig",
    "PhysGNNNetwork", "build_graph_for", "build_model", "build_topology", "describe_training", "fused_attention",
    "load_checkpoint", "load_network_mesh", "mean_euclidean_error", "mesh_output", "model_name",
    "read_description", "read_tensors", "rigid_edge_change", "rigid_edge_loss", "save_checkpoint", "write_tensors",
]
