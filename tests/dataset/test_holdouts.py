import numpy as np
import pytest
from dataset_fakes import block, fake_simulation

from mixpinn.base.errors import InputError
from mixpinn.dataset import (
    HOLD_OUTS,
    Protocol,
    beyond,
    deeper_than,
    hold_out,
    lateral_to,
    probe_path,
    rotation_is,
    split_positions,
    split_samples,
    table_of,
)


@pytest.fixture(scope="module")
def table():
    mesh, protocol = block(3), Protocol(approach=0.0, step=4.0, steps=5)
    return table_of(
        fake_simulation(
            mesh, probe_path((20.0 * position - 90.0, 0.0, position), rotation, protocol), position_index=position,
            rotation_deg=rotation,
        )
        for position in range(10) for rotation in (0.0, 45.0)
    )


def test_position_split_covers_every_sample_once(table):
    parts = split_samples(table, split_positions(10)).parts
    assert sorted(np.concatenate(list(parts.values()))) == list(range(100))
    assert {int(table.position_index[i]) for i in parts["test"]} == set(split_positions(10).test.tolist())


def test_held_rotation_is_never_trained_and_alone_tested(table):
    split = split_positions(10)
    parts = hold_out(table, split, name="rotation-45").parts
    assert set(table.rotation_deg[parts["train"]]) == set(table.rotation_deg[parts["validation"]]) == {0.0}
    assert set(table.rotation_deg[parts["test"]]) == {45.0}
    assert set(table.position_index[parts["test"]]) <= set(split.test)
    assert not set(parts["train"]) & set(parts["test"])


def test_held_depth_is_extrapolation(table):
    parts = hold_out(table, split_positions(10), name="deep").parts
    assert table.depth[parts["train"]].max() == 12.0
    assert table.depth[parts["test"]].min() == 16.0


def test_held_region_is_tested_everywhere(table):
    parts = hold_out(table, split_positions(10), name="lateral", unseen_positions=False).parts
    assert np.abs(table.probe_translation[parts["train"], 0]).max() <= 35.0
    tested = np.unique(table.position_index[parts["test"]])
    assert tested.tolist() == [0, 1, 2, 7, 8, 9]


def test_selectors(table):
    assert rotation_is(45.0)(table).sum() == 50
    assert deeper_than(16.0)(table).sum() == 20
    assert beyond(0, 0.0)(table).sum() == beyond(0, 0.0, sign=-1)(table).sum() == 50
    assert lateral_to(80.0)(table).sum() == 20
    assert all(selector(table).shape == (100,) for selector in HOLD_OUTS.values())


def test_unknown_or_empty_hold_outs_are_refused(table):
    with pytest.raises(InputError, match="rotation-45"):
        hold_out(table, split_positions(10), name="rotation-46")
    with pytest.raises(InputError, match="at least one test sample"):
        hold_out(table, split_positions(10), name="none", held=deeper_than(100.0))
    with pytest.raises(InputError, match="at least one training sample"):
        hold_out(table, split_positions(10), name="all", held=deeper_than(-1.0))
