"""AttentionTopology: the sorted adjacency, self-loops included, that attention layers run over."""

from dataclasses import dataclass, field

import numpy as np
import torch
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee
from torch import Tensor

from mixpinn.base.arrays import AnyArray, IntArray
from mixpinn.base.errors import InputError

CHUNKS = 64
"""Work is cut into this many ranges of equal numbers of slots, whatever the number of threads: results do not vary."""
HUB_DEGREE = 128
"""Nodes with more neighbours are left out of the search for an order: they are near everything."""


@dataclass(frozen=True, eq=False)
class AttentionTopology:
    """Edges grouped by target; N nodes, S = E + N slots (directed edges and one self-loop a node).

    The nodes are renumbered so that neighbours lie close in memory (reverse Cuthill–McKee).

    Attributes:
        order: old index of each new node, int64, shape (N,).
        position: new index of each old node, int64, shape (N,).
        offsets: slots of new node i are offsets[i]:offsets[i + 1], int64, shape (N + 1,).
        sources: source of each slot (new index), ascending within a node, int32, shape (S,).
        reverse: slot of the same edge in the other direction, int32, shape (S,).
        chunks: node ranges of about equal numbers of slots, int64, shape (CHUNKS + 1,).
        edge_slot: slot of each given directed edge, int64, shape (E,).
        loop_slot: slot of the self-loop of each new node, int64, shape (N,).
    """

    order: Tensor
    position: Tensor
    offsets: IntArray
    sources: AnyArray
    reverse: AnyArray
    chunks: IntArray
    edge_slot: Tensor
    loop_slot: Tensor
    _edges: dict[tuple[int, str], Tensor] = field(default_factory=dict, repr=False)
    _orders: dict[str, tuple[Tensor, Tensor]] = field(default_factory=dict, repr=False)

    @property
    def n_nodes(self) -> int:
        """Number of nodes N."""
        return len(self.offsets) - 1

    @property
    def n_slots(self) -> int:
        """Number of slots S."""
        return len(self.sources)

    def orders(self, device: torch.device) -> tuple[Tensor, Tensor]:
        """`order` and `position` on a device; copied there once, since each copy waits for it."""
        key = str(device)
        if key not in self._orders:
            self._orders[key] = self.order.to(device), self.position.to(device)
        return self._orders[key]

    def edges(self, copies: int, device: torch.device) -> Tensor:
        """Source and target of the slots of `copies` disjoint copies of the graph, shape (2, copies · S)."""
        key = (copies, str(device))
        if key not in self._edges:
            target = np.repeat(np.arange(self.n_nodes), np.diff(self.offsets))
            one = torch.from_numpy(np.stack([self.sources.astype(np.int64), target]))
            shift = self.n_nodes * torch.arange(copies).repeat_interleave(self.n_slots)
            self._edges.clear()
            self._edges[key] = (one.repeat(1, copies) + shift).to(device)
        return self._edges[key]

    def slot_features(self, edge_features: Tensor) -> Tensor:
        """Features of the slots from those of the given edges, shape (E, D) → (S, D).

        A self-loop gets the mean over the edges that end in its node, as `GATConv` with ``fill_value="mean"`` gives it.
        """
        device = edge_features.device
        edge_slot, loop_slot = self.edge_slot.to(device), self.loop_slot.to(device)
        counts = torch.from_numpy(np.diff(self.offsets) - 1).to(device)
        slots = edge_features.new_zeros(self.n_slots, edge_features.shape[1]).index_copy(0, edge_slot, edge_features)
        node = torch.repeat_interleave(torch.arange(self.n_nodes, device=device), counts + 1)
        total = edge_features.new_zeros(self.n_nodes, edge_features.shape[1]).index_add(0, node, slots)
        return slots.index_copy(0, loop_slot, total / counts.clamp(min=1)[:, None])

    def __deepcopy__(self, memo: dict[int, object]) -> "AttentionTopology":
        return self


def build_topology(edge_index: Tensor, n_nodes: int, *, reorder: bool = True) -> AttentionTopology:
    """Sort the directed edges `edge_index`, shape (2, E), and add a self-loop to each of `n_nodes` nodes.

    Raises:
        InputError: an edge lacks its opposite, occurs twice, or is a loop.
    """
    source, target = edge_index.cpu().numpy()
    keys = np.sort(target * n_nodes + source)
    if (keys[1:] == keys[:-1]).any() or (source == target).any() or (
        not np.array_equal(keys, np.sort(source * n_nodes + target))
    ):
        raise InputError(
            "edges", expected="each edge once in both directions, without loops", got="another list",
            fix="build the graph from a mesh",
        )
    order = _neighbours_close(source, target, n_nodes) if reorder else np.arange(n_nodes)
    position = np.empty_like(order)
    position[order] = np.arange(n_nodes)
    source, target = np.concatenate([position[[source, target]], np.tile(np.arange(n_nodes), (2, 1))], axis=1)
    ranked = np.lexsort((source, target))
    slot = np.empty_like(ranked)
    slot[ranked] = np.arange(len(ranked))
    source, target = source[ranked], target[ranked]
    offsets = np.searchsorted(target, np.arange(n_nodes + 1))
    chunks = np.searchsorted(offsets, np.linspace(0, len(source), CHUNKS + 1)).astype(np.int64)
    n_edges = edge_index.shape[1]
    return AttentionTopology(
        order=torch.from_numpy(order), position=torch.from_numpy(position), offsets=offsets.astype(np.int64),
        sources=source.astype(np.int32), reverse=np.lexsort((target, source)).astype(np.int32), chunks=chunks,
        edge_slot=torch.from_numpy(slot[:n_edges]), loop_slot=torch.from_numpy(slot[n_edges:]),
    )


def _neighbours_close(source: IntArray, target: IntArray, n_nodes: int) -> IntArray:
    degree = np.bincount(target, minlength=n_nodes)
    kept = (degree[source] <= HUB_DEGREE) & (degree[target] <= HUB_DEGREE)
    ones = np.ones(int(kept.sum()), dtype=np.int8)
    adjacency = csr_matrix((ones, (target[kept], source[kept])), shape=(n_nodes, n_nodes))
    return np.asarray(reverse_cuthill_mckee(adjacency, symmetric_mode=True), dtype=np.int64)
