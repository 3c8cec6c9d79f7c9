import json
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.validated import ArraySpec, load_arrays, load_record


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Toy:
    name: str
    colour: Colour
    counts: tuple[int, ...]
    worst: tuple[float, str] | None = None
    size: float = 1.0


GOOD = {"name": "a", "colour": "blue", "counts": [1, 2], "worst": [0.5, "b"], "size": 2}


def load(tmp_path, **changes):
    (tmp_path / "toy.json").write_text(json.dumps(GOOD | changes))
    return load_record(Toy, tmp_path / "toy.json", remake="make the toy again")


def test_lists_words_and_whole_numbers_become_what_the_record_says(tmp_path):
    assert load(tmp_path) == Toy("a", Colour.BLUE, (1, 2), (0.5, "b"), 2.0)


@pytest.mark.parametrize(("changes", "says"), [
    ({"name": 3}, "name: expected a valid string, got 3"), ({"colour": "green"}, "colour: .*'red' or 'blue'"),
    ({"counts": [1, "2"]}, r"counts\.1: expected a valid integer"), ({"counts": None}, "counts: "),
    ({"worst": [1.0]}, "worst"), ({"size": float("nan")}, "finite"), ({"size": "2"}, "size"),
    ({"weight": 1}, "weight: expected a known entry"),
])
def test_each_damaged_value_is_one_line(tmp_path, changes, says):
    with pytest.raises(InputError, match=says) as caught:
        load(tmp_path, **changes)
    assert "make the toy again" in str(caught.value)
    assert "toy.json" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["[]", "3", "{}", "null"])
def test_another_layout_is_refused(tmp_path, text):
    (tmp_path / "toy.json").write_text(text)
    with pytest.raises(InputError, match="toy"):
        load_record(Toy, tmp_path / "toy.json", remake="make the toy again")


SPECS = {
    "points": ArraySpec("number", ("n", 3)), "nodes": ArraySpec("index", ("c",), low=0, high=3),
    "weights": ArraySpec("number", ("c", "n")), "fixed": ArraySpec("flag", ("n",)),
}
ARRAYS = {
    "points": np.zeros((4, 3)), "nodes": np.array([0, 3]), "weights": np.ones((2, 4)), "fixed": np.zeros(4, dtype=bool),
}


def read(folder, changes, **options):
    for name, array in (ARRAYS | changes).items():
        np.save(folder / f"{name}.npy", array)
    return load_arrays(folder, SPECS, remake="make it again", **options)


def test_good_arrays_are_read(tmp_path):
    for name, array in read(tmp_path, {}, mapped=("weights",)).items():
        np.testing.assert_array_equal(array, ARRAYS[name])


@pytest.mark.parametrize(("name", "array", "says"), [
    ("points", np.zeros((4, 2)), r"shape \(n, 3\)"), ("points", np.zeros(12), r"shape \(n, 3\)"),
    ("points", np.full((4, 3), np.inf), "12 others"), ("points", np.zeros((4, 3), dtype=bool), "kind 'number'"),
    ("nodes", np.array([0.0, 1.0]), "kind 'index'"), ("nodes", np.array([0, 4]), "at most 3, got 4"),
    ("nodes", np.array([-1, 0]), "at least 0, got -1"), ("weights", np.ones((2, 5)), r"shape \(2, 4\)"),
    ("fixed", np.zeros(5, dtype=bool), r"shape \(4\)"),
])
def test_each_damaged_array_is_one_line(tmp_path, name, array, says):
    with pytest.raises(InputError, match=says) as caught:
        read(tmp_path, {name: array})
    assert f"{name}.npy" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_absent_and_short_files_are_refused(tmp_path):
    read(tmp_path, {})
    (tmp_path / "fixed.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(InputError, match="readable array"):
        load_arrays(tmp_path, SPECS, remake="make it again")
    (tmp_path / "fixed.npy").unlink()
    with pytest.raises(InputError, match="readable array"):
        load_arrays(tmp_path, SPECS, remake="make it again")
    assert "fixed" not in load_arrays(tmp_path, SPECS, remake="make it again", optional=("fixed",))
