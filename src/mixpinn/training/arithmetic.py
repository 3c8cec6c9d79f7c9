"""One arithmetic for every training process, whatever else the process computes."""

import torch

_SHAPES = ((500, 16, 6), (64, 64, 64), (4096, 256, 256))
"""Rows, inner length and columns: thin, small and large products, since a library has kernels for each kind."""


def settle_arithmetic() -> None:
    """Let torch choose the kernels of its matrix products now.

    torch and the sparse solver bring a copy each of the same library. If the solver's is in use before torch has
    multiplied its first matrices, some products come out different in their last digits, and a training that continues
    in another process would leave the loss curve that it began. Every training calls this; a process that solves before
    it trains calls it first.
    """
    for rows, inner, columns in _SHAPES:
        left, right = torch.ones(rows, inner), torch.ones(inner, columns)
        product = torch.mm(left, right)  # as a layer does forward, and both ways backward
        torch.mm(product, right.T)
        torch.mm(left.T, product)
        torch.mv(left, right[:, 0].contiguous())

