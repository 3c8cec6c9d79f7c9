import numpy as np
import pytest

from dataset.dataset_fakes import block, fake_simulation
from mixpinn.base.errors import InputError
from mixpinn.dataset import (
    HOLD_OUTS,
    NOISE,
    NOISE_MM,
    Protocol,
    beyond,
    deeper_than,
    held_out_samples,
    hold_out,
    lateral_to,
    probe_path,
    rotation_is,
    split_positions,
    split_samples,
    table_of,
    with_contact_noise,
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


def test_noise_changes_what_a_model_is_told_and_nothing_else(table):
    split = split_positions(10)
    samples = hold_out(table, split, name=NOISE)
    whole = split_samples(table, split)
    for part, chosen in samples.parts.items():
        np.testing.assert_array_equal(chosen, whole.parts[part])
    clean, noisy = table.select(samples.test), held_out_samples(table, samples)
    np.testing.assert_array_equal(noisy.displacement, clean.displacement)
    errors = []
    for index in range(len(clean)):
        difference = noisy.contact_field(index) - clean.contact_field(index)
        free = np.setdiff1d(np.arange(difference.shape[0]), clean.contacts(index))
        assert not difference[free].any()
        errors.append(difference[clean.contacts(index)])
    errors = np.concatenate(errors)
    # 95 % of the standard errors of mean and deviation of as many draws lie within two of these bounds.
    assert abs(errors.mean()) < 4.0 * NOISE_MM / np.sqrt(errors.size)
    assert errors.std() == pytest.approx(NOISE_MM, rel=4.0 / np.sqrt(2.0 * errors.size))


def test_noise_is_drawn_from_its_seed(table):
    first, again, other = (with_contact_noise(table, deviation=0.5, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.contact_error, again.contact_error)
    assert (first.contact_error != other.contact_error).all()


def test_noise_stays_with_its_sample_when_some_are_selected(table):
    noisy = with_contact_noise(table)
    chosen = noisy.select(np.array([7, 2]))
    for place, index in enumerate((7, 2)):
        np.testing.assert_array_equal(chosen.contact_field(place), noisy.contact_field(index))
