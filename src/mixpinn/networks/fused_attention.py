"""Fused graph attention on a CPU: softmax and weighted sum over a sorted adjacency, no tensor of messages."""

from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from mixpinn.base.arrays import Float32Array
from mixpinn.networks import attention_kernels as kernels
from mixpinn.networks.scratch import scratch
from mixpinn.networks.topology import AttentionTopology


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
    return _FusedAttention.apply(  # type: ignore[no-untyped-call]
        x, att_src, att_dst, slot_score, bias, topology, relu,
    )


def _array(tensor: Tensor) -> Float32Array:
    return np.asarray(tensor.detach().contiguous().numpy())


def attend(
    x: Tensor, att_src: Tensor, att_dst: Tensor, slot_score: Tensor | None, bias: Tensor | None,
    topology: AttentionTopology, *, relu: bool, out: Tensor, state: Tensor | None = None,
) -> Tensor:
    """`fused_attention` without gradients, written into `out`, which must not share memory with `x`.

    `state`, shape (B, N, 4, H), receives per node and head a_sᵀ Θ x, a_dᵀ Θ x, maximum and sum of the softmax.
    """
    _share_threads()
    heads, channels = att_src.shape
    batch, n_nodes, _ = x.shape
    if state is None:
        state = torch.from_numpy(scratch.take("state", (batch, n_nodes, 4, heads)))
    shift, score = _shift_and_score(bias, slot_score, heads, channels)
    shape = (batch, n_nodes, heads, channels)
    for x_b, out_b, state_b in zip(_array(x).reshape(shape), _array(out).reshape(shape), _array(state), strict=True):
        kernels.node_scores(x_b, _array(att_src), _array(att_dst), topology.chunks, state_b)
        kernels.aggregate(
            x_b, state_b, score, slot_score is not None, topology.offsets, topology.sources, topology.chunks, shift,
            relu, out_b,
        )
    return out


class _FusedAttention(torch.autograd.Function):
    """Forward keeps Θ x, the output, and per node and head two scores, the maximum and the sum of the softmax."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, att_src: Tensor, att_dst: Tensor, slot_score: Tensor | None, bias: Tensor | None,
        topology: AttentionTopology, relu: bool,
    ) -> Tensor:
        x = x.contiguous()
        out = torch.empty_like(x)
        state = torch.empty(*x.shape[:2], 4, len(att_src))
        attend(x, att_src, att_dst, slot_score, bias, topology, relu=relu, out=out, state=state)
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
        batch, n_nodes, _ = x.shape
        has_score = slot_score is not None
        shift, score = _shift_and_score(bias, slot_score, heads, channels)
        grad_x = torch.empty_like(x)
        grad_score = np.zeros((topology.n_slots if has_score else 1, heads), np.float32)
        # Reused by every sample of the batch: the gradient behind ReLU, per-slot and per-node terms, per-chunk sums.
        masked = scratch.take("masked", (n_nodes, heads, channels))
        grad_logit = scratch.take("grad logit", (topology.n_slots, heads))
        grad_src = scratch.take("grad source", (n_nodes, heads))
        expected = scratch.take("expected", (n_nodes, heads))
        sums = np.zeros((len(topology.chunks) - 1, 3, heads, channels), np.float32)
        shape = (batch, n_nodes, heads, channels)
        for x_b, out_b, state_b, grad_b, grad_x_b in zip(
            _array(x).reshape(shape), _array(out).reshape(shape), _array(state), _array(grad_out).reshape(shape),
            _array(grad_x).reshape(shape), strict=True,
        ):
            kernels.mask_gradient(grad_b, out_b, shift, ctx.relu, topology.chunks, masked, expected, sums)
            kernels.gather_gradient(
                x_b, masked, state_b, expected, score, has_score, topology.offsets, topology.sources,
                topology.reverse, topology.chunks, grad_x_b, grad_logit, grad_src,
            )
            kernels.finish_gradient(
                x_b, _array(att_src), _array(att_dst), grad_logit, grad_src, topology.offsets, topology.chunks,
                has_score, grad_x_b, grad_score, sums,
            )
        grad_bias, grad_att_src, grad_att_dst = torch.from_numpy(sums.sum(axis=0))
        return (
            grad_x, grad_att_src, grad_att_dst, torch.from_numpy(grad_score) if has_score else None,
            None if bias is None else grad_bias.flatten(), None, None,
        )


def _shift_and_score(
    bias: Tensor | None, slot_score: Tensor | None, heads: int, channels: int,
) -> tuple[Float32Array, Float32Array]:
    shift = np.zeros((heads, channels), np.float32) if bias is None else _array(bias).reshape(heads, channels)
    return shift, np.zeros((1, heads), np.float32) if slot_score is None else _array(slot_score)


def _share_threads() -> None:
    """Use as many threads as torch does, so that `torch.set_num_threads` governs both."""
    numba.set_num_threads(min(torch.get_num_threads(), numba.config.NUMBA_NUM_THREADS))
