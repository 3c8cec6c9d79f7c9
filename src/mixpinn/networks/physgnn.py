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
        n_nodes = x.shape[1]
        # On a CPU one sample after another: what a layer leaves is then still in the cache when the next one reads it.
        size = 1 if x.device.type == "cpu" else len(x)
        shift = n_nodes * torch.arange(size, device=x.device).repeat_interleave(edge_index.shape[1])
        edges, weight = edge_index.repeat(1, size) + shift, (1.0 / edge_length).repeat(size)
        for convolutions, activations, jump, arguments in (
            (self.graph_convolutions, self.activations[:3], self.first_jump, (edges, weight)),
            (self.sage_convolutions, self.activations[3:], self.second_jump, (edges,)),
        ):
            parts = []
            for part in torch.split(x, size):
                states = [part.flatten(0, 1)]
                for convolution, activation in zip(convolutions, activations, strict=True):
                    states.append(activation(convolution(states[-1], *arguments)))
                parts.append(jump(states[1:]).view(len(part), n_nodes, -1))
            x = self.dropout(torch.cat(parts))
        return self.head(x)
