"""Batches against dense fields, shuffling, and dealing out to several processes."""

import numpy as np
import pytest
import torch

from mixpinn.graph import virtual_targets
from mixpinn.networks import build_graph_for, mean_euclidean_error
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.training import batches, contact_fields
from mixpinn.training.batches import epoch_order
from mixpinn.training.state import epoch_seed
from training.toy_block import TINY


def test_contact_fields_hold_the_contact_displacement_and_zero_elsewhere(table: SampleTable) -> None:
    fields = contact_fields(table, np.array([3, 0])).numpy()
    for field, index in zip(fields, (3, 0), strict=True):
        sample = table[index]
        np.testing.assert_array_equal(field[sample.contact_nodes], sample.contact_displacement.astype(np.float32))
        others = np.setdiff1d(np.arange(len(field)), sample.contact_nodes)
        assert (field[others] == 0.0).all()
        assert len(sample.contact_nodes) > 0


def test_an_epoch_holds_every_sample_once_with_virtual_targets(mesh: TissueMesh, table: SampleTable) -> None:
    graph = build_graph_for(TINY, mesh)
    made = list(batches(table, graph, batch_size=4))
    assert [len(batch.target) for batch in made] == [4, 4, 2]
    target = torch.cat([batch.target for batch in made])
    torch.testing.assert_close(target[:, : mesh.n_points], torch.from_numpy(table.displacement), rtol=0, atol=0)
    for k in (1, 2):
        mean = table.displacement[:, mesh.part == k].mean(axis=1)
        np.testing.assert_allclose(target[:, mesh.n_points + k - 1].numpy(), mean, atol=1e-6)


def test_the_order_differs_from_epoch_to_epoch_and_follows_from_the_seed() -> None:
    def order(seed: int, epoch: int) -> list[int]:
        return list(epoch_order(50, torch.Generator().manual_seed(epoch_seed(seed, epoch, 0))))

    orders = [order(7, epoch) for epoch in range(1, 5)] + [order(8, 1)]
    assert all(sorted(one) == list(range(50)) for one in orders)
    assert len({tuple(one) for one in orders}) == len(orders)
    assert order(7, 2) == orders[1]
    assert list(epoch_order(3, None)) == [0, 1, 2]


@pytest.mark.parametrize("processes", [2, 3])
def test_processes_together_have_the_mean_loss_of_the_whole_batch(
    mesh: TissueMesh, table: SampleTable, processes: int,
) -> None:
    graph = build_graph_for(TINY, mesh)
    dealt = [
        list(batches(
            table, graph, batch_size=4, generator=torch.Generator().manual_seed(1), rank=rank, processes=processes,
        )) for rank in range(processes)
    ]
    whole = list(batches(table, graph, batch_size=4, generator=torch.Generator().manual_seed(1)))
    assert sum(batch.n_samples for share in dealt for batch in share) == len(table)
    for step, batch in enumerate(whole):
        expected = mean_euclidean_error(torch.zeros_like(batch.target), batch.target)
        shares = [share[step] for share in dealt]
        losses = [one.weight * mean_euclidean_error(torch.zeros_like(one.target), one.target) for one in shares]
        torch.testing.assert_close(torch.stack(losses).mean(), expected)


def test_a_process_without_a_sample_has_no_weight(mesh: TissueMesh, table: SampleTable) -> None:
    graph = build_graph_for(TINY, mesh)
    batch, = batches(table.select(np.array([0])), graph, batch_size=4, rank=1, processes=2)
    assert (batch.n_samples, batch.weight, len(batch.target)) == (0, 0.0, 1)
    torch.testing.assert_close(batch.target, virtual_targets(graph, torch.from_numpy(table.displacement[:1])))
