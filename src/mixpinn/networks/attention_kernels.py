"""Compiled loops of fused graph attention.

Arrays of one sample: n nodes, h heads, c channels a head, s slots; fields of the nodes have shape (n, h, c). `state`
holds for each node and head the source score, the target score, the maximum and the sum of the softmax, shape
(n, 4, h). Loops run in parallel over chunks of nodes that have equal numbers of slots; each node is summed in a fixed
order and each chunk has its own sums, so that the number of threads does not change a result.
"""

import math

import numpy as np
from numba import njit, prange

from mixpinn.base.arrays import AnyArray, Float32Array, IntArray

SLOPE = np.float32(0.2)
"""Slope of LeakyReLU for negative values, as in `GATConv`."""


@njit(parallel=True, fastmath=True, cache=True)
def node_scores(
    x: Float32Array, att_src: Float32Array, att_dst: Float32Array, chunks: IntArray, state: Float32Array,
) -> None:
    """Scores a_sᵀ Θ xᵢ and a_dᵀ Θ xᵢ of each node and head into `state`."""
    heads, channels = att_src.shape
    for chunk in prange(len(chunks) - 1):
        for i in range(chunks[chunk], chunks[chunk + 1]):
            for h in range(heads):
                source = np.float32(0.0)
                target = np.float32(0.0)
                for c in range(channels):
                    value = x[i, h, c]
                    source += value * att_src[h, c]
                    target += value * att_dst[h, c]
                state[i, 0, h] = source
                state[i, 1, h] = target


@njit(inline="always", fastmath=True)
def _leaky(value):  # type: ignore[no-untyped-def]
    return value if value > np.float32(0.0) else SLOPE * value


@njit(parallel=True, fastmath=True, cache=True)
def aggregate(
    x: Float32Array, state: Float32Array, score: Float32Array, has_score: bool, offsets: IntArray, sources: AnyArray,
    chunks: IntArray, bias: Float32Array, relu: bool, out: Float32Array,
) -> None:
    """out_i = Σⱼ αᵢⱼ xⱼ + bias, ReLU if asked; maxima and sums of the softmax into `state`."""
    _, heads, channels = x.shape
    for chunk in prange(len(chunks) - 1):
        longest = 0
        for i in range(chunks[chunk], chunks[chunk + 1]):
            longest = max(longest, offsets[i + 1] - offsets[i])
        weight = np.empty(longest, np.float32)
        total = np.empty(channels, np.float32)
        for i in range(chunks[chunk], chunks[chunk + 1]):
            start, count = offsets[i], offsets[i + 1] - offsets[i]
            for h in range(heads):
                target = state[i, 1, h]
                highest = np.float32(-np.inf)
                for k in range(count):
                    logit = target + state[sources[start + k], 0, h]
                    if has_score:
                        logit += score[start + k, h]
                    weight[k] = _leaky(logit)
                    highest = max(highest, weight[k])
                divisor = np.float32(0.0)
                for k in range(count):
                    weight[k] = np.float32(math.exp(weight[k] - highest))
                    divisor += weight[k]
                state[i, 2, h] = highest
                state[i, 3, h] = divisor
                for c in range(channels):
                    total[c] = np.float32(0.0)
                # Four sources at a time: the total is read and written once for four products.
                whole = count - count % 4
                for k in range(start, start + whole, 4):
                    x0, x1, x2, x3 = x[sources[k], h], x[sources[k + 1], h], x[sources[k + 2], h], x[sources[k + 3], h]
                    w0, w1, w2, w3 = (
                        weight[k - start], weight[k - start + 1], weight[k - start + 2], weight[k - start + 3],
                    )
                    for c in range(channels):
                        total[c] += w0 * x0[c] + w1 * x1[c] + w2 * x2[c] + w3 * x3[c]
                for k in range(whole, count):
                    x0 = x[sources[start + k], h]
                    w0 = weight[k]
                    for c in range(channels):
                        total[c] += w0 * x0[c]
                inverse = np.float32(1.0) / divisor
                floor = np.float32(0.0) if relu else np.float32(-np.inf)
                for c in range(channels):
                    out[i, h, c] = max(total[c] * inverse + bias[h, c], floor)


@njit(parallel=True, fastmath=True, cache=True)
def mask_gradient(
    grad: Float32Array, out: Float32Array, bias: Float32Array, relu: bool, chunks: IntArray, masked: Float32Array,
    expected: Float32Array, sums: Float32Array,
) -> None:
    """Gradient gᵢ before ReLU, gᵢ · Σⱼ αᵢⱼ xⱼ of each head into `expected`, and Σᵢ gᵢ into ``sums[:, 0]``.

    Where ReLU cut, gᵢ is zero, so that the output minus the bias is the weighted sum wherever it counts.
    """
    _, heads, channels = grad.shape
    for chunk in prange(len(chunks) - 1):
        for i in range(chunks[chunk], chunks[chunk + 1]):
            for h in range(heads):
                total, own, value = sums[chunk, 0, h], out[i, h], grad[i, h]
                kept, shift = masked[i, h], bias[h]
                product = np.float32(0.0)
                for c in range(channels):
                    passed = value[c] if own[c] > np.float32(0.0) or not relu else np.float32(0.0)
                    kept[c] = passed
                    total[c] += passed
                    product += passed * (own[c] - shift[c])
                expected[i, h] = product


@njit(parallel=True, fastmath=True, cache=True)
def gather_gradient(
    x: Float32Array, masked: Float32Array, state: Float32Array, expected: Float32Array, score: Float32Array,
    has_score: bool, offsets: IntArray, sources: AnyArray, reverse: AnyArray, chunks: IntArray, grad_x: Float32Array,
    grad_logit: Float32Array, grad_src: Float32Array,
) -> None:
    """For each source j: Σᵢ αᵢⱼ gᵢ into `grad_x`; the gradient of each slot's logit, and its sum over i.

    With dαᵢⱼ = gᵢ · xⱼ the softmax gives αᵢⱼ (dαᵢⱼ − Σₖ αᵢₖ dαᵢₖ), where the sum is `expected`. The graph is symmetric:
    the targets of j are its sources, and the slot of i ← j is the reverse of that of j ← i. Each gᵢ is read once for
    both the product and the sum.
    """
    _, heads, channels = x.shape
    for chunk in prange(len(chunks) - 1):
        longest = 0
        for j in range(chunks[chunk], chunks[chunk + 1]):
            longest = max(longest, offsets[j + 1] - offsets[j])
        weight = np.empty(longest, np.float32)
        slope = np.empty(longest, np.float32)
        product = np.empty(longest, np.float32)
        total = np.empty(channels, np.float32)
        for j in range(chunks[chunk], chunks[chunk + 1]):
            start, count = offsets[j], offsets[j + 1] - offsets[j]
            whole = count - count % 4
            for h in range(heads):
                own, source = x[j, h], state[j, 0, h]
                for k in range(count):
                    i = sources[start + k]
                    logit = source + state[i, 1, h]
                    if has_score:
                        logit += score[reverse[start + k], h]
                    slope[k] = np.float32(1.0) if logit > np.float32(0.0) else SLOPE
                    weight[k] = np.float32(math.exp(slope[k] * logit - state[i, 2, h])) / state[i, 3, h]
                for c in range(channels):
                    total[c] = np.float32(0.0)
                for k in range(0, whole, 4):
                    g0, g1 = masked[sources[start + k], h], masked[sources[start + k + 1], h]
                    g2, g3 = masked[sources[start + k + 2], h], masked[sources[start + k + 3], h]
                    w0, w1, w2, w3 = weight[k], weight[k + 1], weight[k + 2], weight[k + 3]
                    p0 = p1 = p2 = p3 = np.float32(0.0)
                    for c in range(channels):
                        p0 += g0[c] * own[c]
                        p1 += g1[c] * own[c]
                        p2 += g2[c] * own[c]
                        p3 += g3[c] * own[c]
                        total[c] += w0 * g0[c] + w1 * g1[c] + w2 * g2[c] + w3 * g3[c]
                    product[k], product[k + 1], product[k + 2], product[k + 3] = p0, p1, p2, p3
                for k in range(whole, count):
                    g0 = masked[sources[start + k], h]
                    w0 = weight[k]
                    p0 = np.float32(0.0)
                    for c in range(channels):
                        p0 += g0[c] * own[c]
                        total[c] += w0 * g0[c]
                    product[k] = p0
                summed = np.float32(0.0)
                for k in range(count):
                    value = weight[k] * (product[k] - expected[sources[start + k], h]) * slope[k]
                    grad_logit[reverse[start + k], h] = value
                    summed += value
                grad_src[j, h] = summed
                row = grad_x[j, h]
                for c in range(channels):
                    row[c] = total[c]


@njit(parallel=True, fastmath=True, cache=True)
def finish_gradient(
    x: Float32Array, att_src: Float32Array, att_dst: Float32Array, grad_logit: Float32Array, grad_src: Float32Array,
    offsets: IntArray, chunks: IntArray, has_score: bool, grad_x: Float32Array, grad_score: Float32Array,
    sums: Float32Array,
) -> None:
    """Add what flows through the two scores of each node; sums for `att_src` and `att_dst` into ``sums[:, 1:]``."""
    _, heads, channels = x.shape
    for chunk in prange(len(chunks) - 1):
        for i in range(chunks[chunk], chunks[chunk + 1]):
            for h in range(heads):
                target = np.float32(0.0)
                for slot in range(offsets[i], offsets[i + 1]):
                    target += grad_logit[slot, h]
                    if has_score:
                        grad_score[slot, h] += grad_logit[slot, h]
                source = grad_src[i, h]
                total_src, total_dst, own, row = sums[chunk, 1, h], sums[chunk, 2, h], x[i, h], grad_x[i, h]
                towards_src, towards_dst = att_src[h], att_dst[h]
                for c in range(channels):
                    row[c] += source * towards_src[c] + target * towards_dst[c]
                    total_src[c] += source * own[c]
                    total_dst[c] += target * own[c]
