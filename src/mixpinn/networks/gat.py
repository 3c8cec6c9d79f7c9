"""The network of MIXPINN: a stack of graph attention layers."""

from torch import Tensor, nn

from mixpinn.networks.attention import Backend, GraphAttention
from mixpinn.networks.topology import AttentionTopology


class GATNetwork(nn.Module):
    """`layers` attention layers, ReLU between them; heads concatenated, in the last layer averaged into 3 outputs.

    Args:
        n_inputs: features of a node F = 9 + K.
        layers: number of layers (the paper: 8).
        heads: heads a layer (MIXPINN: 2, simple GAT: 1).
        hidden: channels a head.
        n_edge_inputs: features of an edge 1 + K, or None where layers take node features only.
    """

    def __init__(
        self, n_inputs: int, *, layers: int = 8, heads: int = 2, hidden: int = 128, n_edge_inputs: int | None = None,
    ) -> None:
        super().__init__()
        widths = [n_inputs] + [heads * hidden] * (layers - 1)
        self.layers = nn.ModuleList([
            GraphAttention(width, hidden, heads=heads, n_edge_inputs=n_edge_inputs) for width in widths[:-1]
        ])
        self.layers.append(GraphAttention(widths[-1], 3, heads=heads, concat=False, n_edge_inputs=n_edge_inputs))

    def use_backend(self, backend: Backend) -> "GATNetwork":
        """Choose how the layers are computed; returns the network itself."""
        for layer in self.layers:
            layer.backend = backend  # type: ignore[assignment]
        return self

    def forward(self, x: Tensor, topology: AttentionTopology, edge_features: Tensor | None = None) -> Tensor:
        """Node features, shape (B, N, F), and edge features, shape (E, 1 + K) → displacement, shape (B, N, 3)."""
        slots = None if edge_features is None else topology.slot_features(edge_features)
        order, position = topology.orders(x.device)
        x = x[:, order]
        for layer in self.layers[:-1]:
            x = layer(x, topology, slots, relu=True, transient=True)
        return self.layers[-1](x, topology, slots)[:, position]
