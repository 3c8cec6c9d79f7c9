"""GraphAttention: one set of parameters, two ways to compute it."""

from enum import StrEnum

import torch
from torch import Tensor
from torch_geometric.nn import GATConv

from mixpinn.networks.fused_attention import attend, fused_attention
from mixpinn.networks.scratch import scratch
from mixpinn.networks.topology import AttentionTopology


class Backend(StrEnum):
    """How a layer is computed."""

    AUTOMATIC = "automatic"
    """Fused for float32 on a CPU outside autocast, else PyTorch Geometric's."""
    FUSED = "fused"
    REFERENCE = "reference"


class GraphAttention(GATConv):
    r"""Graph attention with the parameters of `GATConv` over a batch that shares one topology.

    x'ᵢ = Σ_{j ∈ N(i) ∪ {i}} αᵢⱼ Θ xⱼ with, for each head,
    αᵢⱼ = softmaxⱼ LeakyReLU(a_dᵀ Θ xᵢ + a_sᵀ Θ xⱼ + a_eᵀ Θₑ eᵢⱼ), slope 0.2 (the paper's equations for x' and α, in
    which the two vectors a are `att_dst` and `att_src`). Heads are concatenated or, with ``concat=False``, averaged.

    Args:
        n_inputs: features of a node F.
        channels: channels of a head C.
        heads: number of heads H.
        concat: whether heads are concatenated or averaged.
        n_edge_inputs: features of an edge D, or None to leave edge features out.
    """

    backend: Backend = Backend.AUTOMATIC

    def __init__(
        self, n_inputs: int, channels: int, *, heads: int, concat: bool = True, n_edge_inputs: int | None = None,
    ) -> None:
        # The topology carries the self-loops already.
        super().__init__(n_inputs, channels, heads=heads, concat=concat, edge_dim=n_edge_inputs, add_self_loops=False)

    def forward(  # type: ignore[override, unused-ignore]
        self, x: Tensor, topology: AttentionTopology, slot_features: Tensor | None = None, *, relu: bool = False,
        transient: bool = False,
    ) -> Tensor:
        """Apply the layer.

        Args:
            x: node features in the topology's order, shape (B, N, F).
            topology: the adjacency with self-loops.
            slot_features: features of its slots, shape (S, D), where the layer has edge features.
            relu: whether ReLU follows.
            transient: without gradients, the result may lie in scratch memory, valid until the next transient result.

        Returns:
            shape (B, N, H · C) or, with averaged heads, (B, N, C).
        """
        fused = x.device.type == "cpu" and x.dtype == torch.float32 and not torch.is_autocast_enabled("cpu")
        if self.backend is Backend.FUSED or (self.backend is Backend.AUTOMATIC and fused):
            return self._fused(x, topology, slot_features, relu, transient)
        batch, n_nodes, _ = x.shape
        attributes = None if self.lin_edge is None or slot_features is None else slot_features.repeat(batch, 1)
        out = super().forward(x.flatten(0, 1), topology.edges(batch, x.device), attributes)
        return (out.relu() if relu else out).view(batch, n_nodes, -1)

    def _fused(
        self, x: Tensor, topology: AttentionTopology, slot_features: Tensor | None, relu: bool, transient: bool,
    ) -> Tensor:
        heads, channels = self.heads, self.out_channels
        slot_score = None
        if self.lin_edge is not None and slot_features is not None:
            # a_eᵀ Θₑ e = (Θₑᵀ a_e)ᵀ e: D products an edge and head instead of C · D.
            folded = (self.lin_edge.weight.view(heads, channels, -1) * self.att_edge[0][:, :, None]).sum(dim=1)
            slot_score = slot_features @ folded.T
        vectors = self.att_src[0], self.att_dst[0], slot_score, self.bias if self.concat else None
        if torch.is_grad_enabled():
            out = fused_attention(self.lin(x), *vectors, topology, relu=relu and self.concat)
        else:
            shape = (*x.shape[:2], heads * channels)
            transformed = torch.from_numpy(scratch.take("transformed", shape))
            torch.mm(x.flatten(0, 1), self.lin.weight.T, out=transformed.flatten(0, 1))
            result = torch.from_numpy(scratch.take("result", shape)) if transient else torch.empty(shape)
            out = attend(transformed, *vectors, topology, relu=relu and self.concat, out=result)
        if self.concat:
            return out
        out = out.view(*x.shape[:2], heads, channels).mean(dim=2) + self.bias
        return out.relu() if relu else out
