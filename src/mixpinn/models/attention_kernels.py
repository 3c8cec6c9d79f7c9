"""Compiled loops of fused graph attention.

Arrays of one sample: n nodes, h heads, c channels a head, w = h · c, s slots. `state` holds for each node and head the
source score, the target score, the maximum and the sum of the softmax, shape (n, 4, h). Loops run in parallel over
chunks of nodes; each node is summed in a fixed order and each chunk has its own sums, so that the number of threads
does not change a result.
"""

import math


import numpy as np
from numba import njit, prange

from mixpinn.base.arrays import AnyArray, Float32Array, IntArray

SLOPE = np.float32(0.2)
"""Slope of LeakyReLU for negative values, as in `GATConv`."""


@njit(parallel=True, fastmath=True, cache=True)
def node_scores(x: Float32Array, att_src: Float32Array, att_dst: Float32Array, chunks: IntArray, state: Float32Array) -> None:
    """Scores a_sᵀ Θ xᵢ and a_dᵀ Θ xᵢ of each node and head into `state`; x has shape (n, h, c)."""
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
    """out_i = Σⱼ αᵢⱼ xⱼ + bias, ReLU if asked; maxima and sums of the softmax into `state`; x has shape (n, w)."""
    heads = state.shape[2]
    channels = x.shape[1] // heads
    for chunk in prange(len(chunks) - 1):
        longest = 4
        for i in range(chunks[chunk], chunks[chunk + 1]):
            longest = max(longest, offsets[i + 1] - offsets[i])
        weight = np.empty((heads, longest), np.float32)
        for i in range(chunks[chunk], chunks[chunk + 1]):
            start, count = offsets[i], offsets[i + 1] - offsets[i]
            for h in range(heads):
                target = state[i, 1, h]
                highest = np.float32(-np.inf)
                for k in range(count):
                    logit = target + state[sources[start + k], 0, h]
                    if has_score:
                        logit += score[start + k, h]
                    logit = _leaky(logit)
                    weight[h, k] = logit
                    highest = max(highest, logit)
                total = np.float32(0.0)
                for k in range(count):
                    value = np.float32(math.exp(weight[h, k] - highest))
                    weight[h, k] = value
                    total += value
                inverse = np.float32(1.0) / total
                for k in range(count):
                    weight[h, k] *= inverse
                state[i, 2, h] = highest
                state[i, 3, h] = total
            row = out[i]
            row[:] = bias
            # Four sources at a time: the row is read and written once for four products.
            whole = count - count % 4
            for k in range(0, whole, 4):
                first, second = x[sources[start + k]], x[sources[start + k + 1]]
                third, fourth = x[sources[start + k + 2]], x[sources[start + k + 3]]
                for h in range(heads):
                    a, b, c, d = weight[h, k], weight[h, k + 1], weight[h, k + 2], weight[h, k + 3]
                    for m in range(h * channels, (h + 1) * channels):
                        row[m] += a * first[m] + b * second[m] + c * third[m] + d * fourth[m]
            for k in range(whole, count):
                first = x[sources[start + k]]
                for h in range(heads):
                    a = weight[h, k]
                    for m in range(h * channels, (h + 1) * channels):
                        row[m] += a * first[m]
            if relu:
                for m in range(len(row)):
                    row[m] = max(row[m], np.float32(0.0))


@njit(parallel=True, fastmath=True, cache=True)
def mask_gradient(
    grad: Float32Array, out: Float32Array, bias: Float32Array, relu: bool, chunks: IntArray, masked: Float32Array,
    expected: Float32Array, sums: Float32Array,
) -> None:
    """Gradient gᵢ before ReLU, gᵢ · Σⱼ αᵢⱼ xⱼ of each head into `expected`, and Σᵢ gᵢ into ``sums[:, 0]``.

    Where ReLU cut, gᵢ is zero, so that the output minus the bias is the weighted sum wherever it counts.
    """
    heads = expected.shape[1]
    channels = grad.shape[1] // heads
    for chunk in prange(len(chunks) - 1):
        total = sums[chunk, 0]
        for i in range(chunks[chunk], chunks[chunk + 1]):
            for h in range(heads):
                product = np.float32(0.0)
                for m in range(h * channels, (h + 1) * channels):
                    value = grad[i, m]
                    if relu and out[i, m] <= np.float32(0.0):
                        value = np.float32(0.0)
                    masked[i, m] = value
                    total[m] += value
                    product += value * (out[i, m] - bias[m])
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
    heads = state.shape[2]
    channels = x.shape[1] // heads
    for chunk in prange(len(chunks) - 1):
        longest = 4
        for j in range(chunks[chunk], chunks[chunk + 1]):
            longest = max(longest, offsets[j + 1] - offsets[j])
        weight = np.empty((heads, longest), np.float32)
        slope = np.empty((heads, longest), np.float32)
        for j in range(chunks[chunk], chunks[chunk + 1]):
            start, count = offsets[j], offsets[j + 1] - offsets[j]
            own, row = x[j], grad_x[j]
            row[:] = np.float32(0.0)
            for h in range(heads):
                source = state[j, 0, h]
                for k in range(count):
                    i = sources[start + k]
                    logit = source + state[i, 1, h]
                    if has_score:
                        logit += score[reverse[start + k], h]
                    slope[h, k] = np.float32(1.0) if logit > np.float32(0.0) else SLOPE
                    weight[h, k] = np.float32(math.exp(_leaky(logit) - state[i, 2, h])) / state[i, 3, h]
            for h in range(heads):
                total = np.float32(0.0)
                whole = count - count % 4
                for k in range(0, whole, 4):
                    i0, i1 = sources[start + k], sources[start + k + 1]
                    i2, i3 = sources[start + k + 2], sources[start + k + 3]
                    first, second, third, fourth = masked[i0], masked[i1], masked[i2], masked[i3]
                    a, b, c, d = weight[h, k], weight[h, k + 1], weight[h, k + 2], weight[h, k + 3]
                    p = q = r = s = np.float32(0.0)
                    for m in range(h * channels, (h + 1) * channels):
                        value = own[m]
                        p += first[m] * value
                        q += second[m] * value
                        r += third[m] * value
                        s += fourth[m] * value
                        row[m] += a * first[m] + b * second[m] + c * third[m] + d * fourth[m]
                    p = a * (p - expected[i0, h]) * slope[h, k]
                    q = b * (q - expected[i1, h]) * slope[h, k + 1]
                    r = c * (r - expected[i2, h]) * slope[h, k + 2]
                    s = d * (s - expected[i3, h]) * slope[h, k + 3]
                    grad_logit[reverse[start + k], h] = p
                    grad_logit[reverse[start + k + 1], h] = q
                    grad_logit[reverse[start + k + 2], h] = r
                    grad_logit[reverse[start + k + 3], h] = s
                    total += p + q + r + s
                for k in range(whole, count):
                    i = sources[start + k]
                    first = masked[i]
                    a = weight[h, k]
                    p = np.float32(0.0)
                    for m in range(h * channels, (h + 1) * channels):
                        p += first[m] * own[m]
                        row[m] += a * first[m]
                    p = a * (p - expected[i, h]) * slope[h, k]
                    grad_logit[reverse[start + k], h] = p
                    total += p
                grad_src[j, h] = total


@njit(parallel=True, fastmath=True, cache=True)
def finish_gradient(
    x: Float32Array, att_src: Float32Array, att_dst: Float32Array, grad_logit: Float32Array, grad_src: Float32Array,
    offsets: IntArray, chunks: IntArray, has_score: bool, grad_x: Float32Array, grad_score: Float32Array,
    sums: Float32Array,
) -> None:
    """Add what flows through the two scores of each node; sums for `att_src` and `att_dst` into ``sums[:, 1:]``."""
    heads = grad_src.shape[1]
    channels = x.shape[1] // heads
    for chunk in prange(len(chunks) - 1):
        total_src, total_dst = sums[chunk, 1], sums[chunk, 2]
        for i in range(chunks[chunk], chunks[chunk + 1]):
            for h in range(heads):
                target = np.float32(0.0)
                for slot in range(offsets[i], offsets[i + 1]):
                    target += grad_logit[slot, h]
                    if has_score:
                        grad_score[slot, h] += grad_logit[slot, h]
                source = grad_src[i, h]
                for m in range(h * channels, (h + 1) * channels):
                    value = x[i, m]
                    grad_x[i, m] += source * att_src[m] + target * att_dst[m]
                    total_src[m] += source * value
                    total_dst[m] += target * value


