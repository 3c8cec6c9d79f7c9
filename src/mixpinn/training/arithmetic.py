"""One arithmetic for every training process, whatever else the process computes."""

import torch


def settle_arithmetic() -> None:
    """Let torch choose the kernels of its matrix products now.

    torch and the sparse solver bring a copy each of the same library. If the solver's is in use before torch has
    multiplied its first matrices, some products come out different in their last digits, and a training that is gone on
    with in another process would leave the loss curve that it began.
    """
    for rows, inner, columns in ((500, 16, 6), (64, 64, 64)):
        torch.mm(torch.ones(rows, inner), torch.ones(inner, columns))


settle_arithmetic()
