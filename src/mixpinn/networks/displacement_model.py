"""DisplacementModel: a network with its graph and scaling, from contact displacement to displacement, in mm."""

import math

import torch
from torch import Tensor, nn

from mixpinn.base.bounded import require_memory
from mixpinn.graph import (
    MeshGraph,
    Scaling,
    ScalingStatistics,
    VirtualEdges,
    VirtualNodes,
    build_graph,
    identity_statistics,
    node_input,
    standard_statistics,
)
from mixpinn.networks.config import ModelConfig
from mixpinn.networks.gat import GATNetwork
from mixpinn.networks.physgnn import PhysGNNNetwork
from mixpinn.networks.topology import build_topology
from mixpinn.records import TissueMesh


class DisplacementModel(nn.Module):
    """Predicts the displacement of all nodes from that of the contact nodes.

    The state holds the weights and the scaling statistics; the graph is rebuilt from the mesh, whose hash is
    ``graph.mesh_hash``.

    Args:
        config: which network.
        graph: the topology, made by `build_graph_for` with the same configuration.
        network: takes scaled node features, shape (B, N, 9 + K), to scaled displacement, shape (B, N, 3).
    """

    input_shift: Tensor
    input_scale: Tensor
    edge_shift: Tensor
    edge_scale: Tensor
    output_scale: Tensor

    def __init__(self, config: ModelConfig, graph: MeshGraph, network: GATNetwork | PhysGNNNetwork) -> None:
        super().__init__()
        self.config, self.graph, self.network = config, graph, network
        self.topology = build_topology(graph.edge_index, graph.n_nodes) if isinstance(network, GATNetwork) else None
        for name, value in vars(identity_statistics(graph)).items():
            self.register_buffer(name, value)

    def fit_scaling(self, displacement: Tensor) -> None:
        """Set the scaling statistics from training targets, shape (S, n, 3) [mm]; nothing for `Scaling.NONE`."""
        if self.config.scaling is Scaling.STANDARD:
            self.set_scaling(standard_statistics(self.graph, displacement))

    def set_scaling(self, statistics: ScalingStatistics) -> None:
        """Take over `statistics`."""
        for name, value in vars(statistics).items():
            getattr(self, name).copy_(value)

    def forward(self, contact_displacement: Tensor) -> Tensor:
        """Predict.

        Args:
            contact_displacement: displacement of the contact nodes, zero elsewhere [mm], shape (B, n, 3).

        Returns:
            displacement of all nodes, virtual ones last [mm], shape (B, N, 3).

        Raises:
            InputError: the field is not one of this graph's mesh.
        """
        graph = self._graph_on(contact_displacement.device)
        x = (node_input(graph, contact_displacement) - self.input_shift) / self.input_scale
        if isinstance(self.network, GATNetwork):
            edges = (graph.edge_features - self.edge_shift) / self.edge_scale if self.config.edge_features else None
            out = self.network(x, self.topology, edges)
        else:
            out = self.network(x, graph.edge_index, graph.edge_length)
        return out * self.output_scale

    def _graph_on(self, device: torch.device) -> MeshGraph:
        if self.graph.position.device != device:
            self.graph = self.graph.to(device)
        return self.graph


def mesh_output(model: DisplacementModel, displacement: Tensor) -> Tensor:
    """The mesh nodes of a model's output: shape (B, N, 3) → (B, n, 3)."""
    return displacement[:, : model.graph.n_mesh_nodes]


def build_graph_for(config: ModelConfig, mesh: TissueMesh) -> MeshGraph:
    """The graph of `mesh` with the virtual nodes and edges that `config` asks for."""
    graph = build_graph(mesh)
    if config.virtual_edges:
        graph = VirtualEdges()(graph)
    if config.virtual_nodes:
        graph = VirtualNodes()(graph)
    return graph


def build_model(config: ModelConfig, graph: MeshGraph, *, seed: int = 0) -> DisplacementModel:
    """A freshly initialised model.

    PyTorch Geometric initialises from torch's global generator: it is seeded with `seed` here and put back afterwards.

    Args:
        config: which network.
        graph: made by `build_graph_for` with the same configuration.
        seed: of the initial weights.

    Raises:
        InputError: a network that does not fit into the memory at hand.
    """
    shapes = parameter_shapes(config, graph)
    require_memory(
        16 * sum(map(math.prod, shapes.values())), what="model", holds=f"{len(shapes)} tensors with what trains them",
        fix="choose fewer layers, heads or channels",
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = _network(config, graph)
    return DisplacementModel(config, graph, network)


def parameter_shapes(config: ModelConfig, graph: MeshGraph) -> dict[str, tuple[int, ...]]:
    """Shape of each tensor of the network by name, without any of them being made; operands as in `build_model`."""
    with torch.random.fork_rng(devices=[]), torch.device("meta"):
        network = _network(config, graph)
    return {f"network.{name}": tuple(tensor.shape) for name, tensor in network.state_dict().items()}


def _network(config: ModelConfig, graph: MeshGraph) -> GATNetwork | PhysGNNNetwork:
    if config.architecture == "physgnn":
        return PhysGNNNetwork(graph.n_inputs, hidden=config.hidden)
    return GATNetwork(
        graph.n_inputs, layers=config.layers, heads=config.heads, hidden=config.hidden,
        n_edge_inputs=graph.edge_features.shape[1] if config.edge_features else None,
    )
