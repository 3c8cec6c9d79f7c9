"""Batches of samples on one shared topology, made when they are needed."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from mixpinn.base.arrays import AnyArray
from mixpinn.graph import MeshGraph, virtual_targets
from mixpinn.records import SampleTable


@dataclass(frozen=True, eq=False)
class Batch:
    """Samples that pass through the network together; b samples, n mesh nodes, N nodes with the virtual ones.

    Attributes:
        contact_displacement: displacement of the contact nodes, zero elsewhere [mm], float32, shape (b, n, 3).
        target: displacement of all nodes, a virtual node's being its part's mean [mm], float32, shape (b, N, 3).
        weight: what the mean loss over this batch counts for in the mean over all processes; 1 in a single process.
        n_samples: samples of this process, b, or 0 where the one sample stands in for none.
    """

    contact_displacement: Tensor
    target: Tensor
    weight: float
    n_samples: int


def contact_fields(table: SampleTable, indices: AnyArray) -> Tensor:
    """The models' input for the samples `indices`: contact displacement, zero elsewhere [mm], shape (b, n, 3)."""
    return torch.tensor(np.stack([table.contact_field(int(index)) for index in indices]))


def epoch_order(n_samples: int, generator: torch.Generator | None) -> AnyArray:
    """Sample indices in the order of one epoch: shuffled by `generator`, or ascending without one."""
    if generator is None:
        return np.arange(n_samples)
    return torch.randperm(n_samples, generator=generator).numpy()


def batch_count(n_samples: int, batch_size: int) -> int:
    """Number of batches of an epoch; the last may be smaller."""
    return math.ceil(n_samples / batch_size)


def batches(
    table: SampleTable, graph: MeshGraph, *, batch_size: int, generator: torch.Generator | None = None,
    rank: int = 0, processes: int = 1,
) -> Iterator[Batch]:
    """Yield all samples once, `batch_size` at a time, inputs and targets made on the fly.

    With several processes each batch is dealt out among them, sample j to process j modulo `processes`, and
    weighted so that the mean over the processes of weight × (mean loss over the process's share) is the mean loss
    over the whole batch: the number of processes does not change what is learnt.

    Args:
        table: the samples; of ten-node cells their vertices count.
        graph: topology that the network reads, of the same mesh.
        batch_size: samples of a batch over all processes.
        generator: shuffles the samples; None keeps their order. Every process needs one with the same state.
        rank: of this process.
        processes: their number.

    Raises:
        InputError: the table is of another mesh.
    """
    table = table.on_vertices(graph.n_mesh_nodes)
    order = epoch_order(len(table), generator)
    for start in range(0, len(order), batch_size):
        whole = order[start: start + batch_size]
        share = whole[rank::processes]
        # Every process must take part in every gradient exchange: one without samples brings a weight of zero.
        present = share if len(share) else whole[:1]
        target = torch.tensor(table.displacement[present], dtype=torch.float32)
        yield Batch(
            contact_fields(table, present).to(torch.float32), virtual_targets(graph, target),
            weight=len(share) * processes / len(whole), n_samples=len(share),
        )
