import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mixpinn.base.errors import InputError
from mixpinn.dataset import Split, split_positions, split_sofa_subset


def test_paper_split_is_93_26_13(shared_data):
    split = split_positions(132)
    assert [len(part) for part in split.parts.values()] == [93, 26, 13]
    published = json.loads((shared_data / "patient1/split.json").read_text())
    for part, key in zip(split.parts.values(), ("train", "val", "test"), strict=True):
        assert part.tolist() == sorted(published[key])


def test_published_split_file_is_read(shared_data):
    split = Split.load(shared_data / "patient1/split.json")
    np.testing.assert_array_equal(split.test, split_positions(132).test)


@given(n=st.integers(3, 500), seed=st.integers(0, 100))
def test_parts_are_disjoint_complete_and_never_empty(n, seed):
    split = split_positions(n, seed=seed)
    parts = list(split.parts.values())
    assert all(len(part) for part in parts)
    assert np.sort(np.concatenate(parts)).tolist() == list(range(n))
    np.testing.assert_array_equal(split.train, split_positions(n, seed=seed).train)


@given(
    n=st.integers(3, 60), a=st.floats(0.01, 0.98), b=st.floats(0.01, 0.98),
)
def test_any_ratios_leave_no_part_empty(n, a, b):
    low, high = min(a, b), max(a, b)
    ratios = (low, high - low + 1e-9, 1.0 - high - 1e-9)
    if min(ratios) <= 0:
        return
    split = split_positions(n, ratios=ratios)
    assert all(len(part) for part in split.parts.values())


@pytest.mark.parametrize(("n", "counts"), [(3, (1, 1, 1)), (10, (7, 2, 1)), (24, (18, 4, 2)), (30, (21, 6, 3))])
def test_shares_are_rounded_down_for_validation_and_test(n, counts):
    assert tuple(len(part) for part in split_positions(n).parts.values()) == counts


@given(st.sets(st.integers(0, 300), min_size=3))
def test_every_fifth_position_tests(positions):
    ordered = sorted(positions)
    split = split_sofa_subset(np.array([*ordered, *ordered]))
    assert split.test.tolist() == [ordered[i] for i in range(len(ordered)) if i % 5 == 2]
    assert sorted([*split.train, *split.test]) == ordered


@given(st.sets(st.integers(0, 300), min_size=8))
def test_every_sixth_of_the_rest_validates(positions):
    split = split_sofa_subset(np.array(list(positions)), validate=True)
    rest = [p for i, p in enumerate(sorted(positions)) if i % 5 != 2]
    assert split.validation.tolist() == [p for i, p in enumerate(rest) if i % 6 == 3]
    assert sorted([*split.train, *split.validation, *split.test]) == sorted(positions)


def test_round_trip(tmp_path):
    split = split_positions(20)
    split.save(tmp_path / "split.json")
    again = Split.load(tmp_path / "split.json")
    assert again.name == split.name
    for part in ("train", "validation", "test"):
        np.testing.assert_array_equal(getattr(again, part), getattr(split, part))


def test_an_altered_split_is_refused(tmp_path):
    split_positions(20).save(tmp_path / "split.json")
    text = (tmp_path / "split.json").read_text()
    (tmp_path / "split.json").write_text(text.replace('"positions-42"', '"positions-43"'))
    with pytest.raises(InputError, match="altered after it was made"):
        Split.load(tmp_path / "split.json")


def test_overlap_is_refused(tmp_path):
    with pytest.raises(InputError, match="each position in one part"):
        Split("bad", np.array([1, 2]), np.array([3]), np.array([2]))
    (tmp_path / "split.json").write_text('{"train": [1, 1], "val": [], "test": [2]}')
    with pytest.raises(InputError, match="each position in one part"):
        Split.load(tmp_path / "split.json")


@pytest.mark.parametrize("text", ["[1, 2]", '{"train": [1]}', '{"train": ["x"], "val": [], "test": []}', "{"])
def test_damaged_split_file_is_refused(tmp_path, text):
    (tmp_path / "split.json").write_text(text)
    with pytest.raises(InputError, match=r"split\.json"):
        Split.load(tmp_path / "split.json")


def test_too_few_positions_and_bad_ratios_are_refused():
    with pytest.raises(InputError, match="at least 3"):
        split_positions(2)
    with pytest.raises(InputError, match="at least 3"):
        split_sofa_subset(np.array([1, 1, 2]))
    with pytest.raises(InputError, match="ratios"):
        split_positions(10, ratios=(0.7, 0.2, 0.2))
