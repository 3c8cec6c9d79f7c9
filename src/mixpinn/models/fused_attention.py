"""Fused graph attention on a CPU: softmax and weighted sum over a sorted adjacency, no tensor of messages."""

from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from mixpinn.base.arrays import Float32Array
from mixpinn.models import attention_kernels as kernels
from mixpinn.models.topology import AttentionTopology


def fused_attention(
    x: Tensor, att_src: Tensor, att_dst: Tensor, slot_score: Tensor | None, bias: Tensor | None,
    topology: AttentionTopology, *, relu: bool,
) -> Tensor:
    """Attention over all heads, bias and ReLU of a layer, differentiable.

    Args:
        x: transformed features Θ x in the topology's order, float32, shape (B, N, H · C).
        att_src, att_dst: attention vectors of source and target, shape (H, C).
        slot_score: edge term a_eᵀ Θₑ e of each slot, shape (S, H), or None.
        bias: shape (H · C,), or None.
        topology: the adjacency with self-loops.
        relu: whether ReLU follows.

    Returns:
        shape (B, N, H · C), heads concatenated.
    """
    return _FusedAttention.apply(x, att_src, att_dst, slot_score, bias, topology, relu)


def _array(tensor: Tensor) -> Float32Array:
    return np.asarray(tensor.detach().contiguous().numpy())


def _empty(*shape: int) -> tuple[Tensor, Float32Array]:
    tensor = torch.empty(shape)
    return tensor, np.asarray(tensor.numpy())


class _FusedAttention(torch.autograd.Function):
    """Forward keeps Θ x, the output, and per node and head two scores, the maximum and the sum of the softmax."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, att_src: Tensor, att_dst: Tensor, slot_score: Tensor | None, bias: Tensor | None,
        topology: AttentionTopology, relu: bool,
    ) -> Tensor:
        _share_threads()
        heads, channels = att_src.shape
        batch, n_nodes, _ = x.shape
        x = x.detach().contiguous()
        out = torch.empty_like(x)
        # Per node and head: a_sᵀ Θ x, a_dᵀ Θ x, maximum and sum of the softmax.
        state = torch.empty(batch, n_nodes, 4, heads)
        bias_array = np.zeros(heads * channels, np.float32) if bias is None else _array(bias)
        has_score = slot_score is not None
        score = np.zeros((1, heads), np.float32) if slot_score is None else _array(slot_score)
        for x_b, out_b, state_b in zip(_array(x), _array(out), _array(state), strict=True):
            shape = (n_nodes, heads, channels)
            kernels.node_scores(x_b.reshape(shape), _array(att_src), _array(att_dst), topology.chunks, state_b)
            kernels.aggregate(
                x_b, state_b, score, has_score, topology.offsets, topology.sources, topology.chunks, bias_array, relu,
                out_b,
            )
        ctx.save_for_backward(x, att_src, att_dst, slot_score, bias, out, state)
        ctx.topology, ctx.relu = topology, relu
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_out: Tensor) -> tuple[Tensor | None, ...]:
        _share_threads()
        x, att_src, att_dst, slot_score, bias, out, state = ctx.saved_tensors
        topology: AttentionTopology = ctx.topology
        heads, channels = att_src.shape
        batch, n_nodes, width = x.shape
        n_chunks = len(topology.chunks) - 1
        bias_array = np.zeros(width, np.float32) if bias is None else _array(bias)
        has_score = slot_score is not None
        score = np.zeros((1, heads), np.float32) if slot_score is None else _array(slot_score)
        grad_x, grad_x_array = _empty(batch, n_nodes, width)
        grad_score = np.zeros((topology.n_slots if has_score else 1, heads), np.float32)
        # Reused by every sample of the batch: the gradient behind ReLU, per-slot scores, per-chunk sums.
        masked = np.empty((n_nodes, width), np.float32)
        grad_logit = np.empty((topology.n_slots, heads), np.float32)
        grad_src = np.empty((n_nodes, heads), np.float32)
        expected = np.empty((n_nodes, heads), np.float32)
        sums = np.zeros((n_chunks, 3, width), np.float32)
        src, dst = _array(att_src).ravel(), _array(att_dst).ravel()
        for x_b, out_b, state_b, grad_b, grad_x_b in zip(
            _array(x), _array(out), _array(state), _array(grad_out), grad_x_array, strict=True,
        ):
            kernels.mask_gradient(
                grad_b, out_b, bias_array, ctx.relu, topology.chunks, masked, expected, sums,
            )
            kernels.gather_gradient(
                x_b, masked, state_b, expected, score, has_score, topology.offsets, topology.sources,
                topology.reverse, topology.chunks, grad_x_b, grad_logit, grad_src,
            )
            kernels.finish_gradient(
                x_b, src, dst, grad_logit, grad_src, topology.offsets, topology.chunks, has_score, grad_x_b,
                grad_score, sums,
            )
        total = torch.from_numpy(sums.sum(axis=0))
        return (
            grad_x, total[1].view(heads, channels), total[2].view(heads, channels),
            torch.from_numpy(grad_score) if has_score else None, None if bias is None else total[0], None, None,
        )


def _share_threads() -> None:
    """Use as many threads as torch does, so that `torch.set_num_threads` governs both."""
    numba.set_num_threads(min(torch.get_num_threads(), numba.config.NUMBA_NUM_THREADS))
