"""PhysGNN (Salehi and Giannacopoulos 2022), the baseline of the paper, sized as its authors sized it."""

import torch
from torch import Tensor, nn
from torch_geometric.nn import GraphConv, JumpingKnowledge, SAGEConv


class PhysGNNNetwork(nn.Module):
    """Three GraphConv and three SAGEConv layers, an LSTM jumping knowledge over each three, two dense layers.

    GraphConv aggregates by sum, sum and maximum with edge weight 1 / length, SAGEConv by maximum. PReLU follows each
    convolution and the first dense layer; dropout follows each jumping knowledge.

    Args:
        n_inputs: features of a node F = 9 + K.
        hidden: channels of the convolutions.
        dense: channels of the first dense layer.
        dropout: probability of dropout.
    """

    def __init__(self, n_inputs: int, *, hidden: int = 112, dense: int = 63, dropout: float = 0.1) -> None:
        super().__init__()
        self.graph_convolutions = nn.ModuleList([
            GraphConv(n_inputs, hidden, aggr="add"), GraphConv(hidden, hidden, aggr="add"),
            GraphConv(hidden, hidden, aggr="max"),
        ])
        self.sage_convolutions = nn.ModuleList([SAGEConv(hidden, hidden, aggr="max") for _ in range(3)])
        self.activations = nn.ModuleList([nn.PReLU() for _ in range(6)])
        self.first_jump = JumpingKnowledge("lstm", channels=hidden, num_layers=3)
        self.second_jump = JumpingKnowledge("lstm", channels=hidden, num_layers=3)
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Sequential(nn.Linear(hidden, dense), nn.PReLU(), nn.Linear(dense, 3))

    def forward(self, x: Tensor, edge_index: Tensor, edge_length: Tensor) -> Tensor:
        """Node features, shape (B, N, F), edges, shape (2, E), lengths [mm], shape (E,) → shape (B, N, 3)."""
        batch, n_nodes, _ = x.shape
        # A batch is B disjoint copies of the shared topology.
        shift = n_nodes * torch.arange(batch, device=x.device).repeat_interleave(edge_index.shape[1])
        edges, weight = edge_index.repeat(1, batch) + shift, (1.0 / edge_length).repeat(batch)
        x = x.flatten(0, 1)
        states = []
        for convolution, activation in zip(self.graph_convolutions, self.activations[:3], strict=True):
            x = activation(convolution(x, edges, weight))
            states.append(x)
        x = self.dropout(self.first_jump(states))
        states = []
        for convolution, activation in zip(self.sage_convolutions, self.activations[3:], strict=True):
            x = activation(convolution(x, edges))
            states.append(x)
        x = self.dropout(self.second_jump(states))
        return self.head(x).view(batch, n_nodes, 3)
