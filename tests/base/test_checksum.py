import json
from dataclasses import dataclass

import numpy as np
import pytest

from mixpinn.base.checksum import with_checksum, without_checksum
from mixpinn.base.errors import InputError
from mixpinn.base.validated import load_record, save_record


@dataclass(frozen=True)
class Toy:
    name: str
    size: float = 1.0
    worst: float | None = None


def test_values_come_back_and_older_ones_stay():
    values = {"b": (1, 2.5), "a": np.array([0.1, np.nan]), "c": {"d": None}}
    kept = json.loads(json.dumps(with_checksum(values)))
    assert list(kept) == ["b", "a", "c", "sha256"]
    back = without_checksum(kept, "x.json", remake="make it again")
    assert list(back) == ["b", "a", "c"]
    assert back["b"] == [1, 2.5]
    assert without_checksum({"b": 1}, "x.json", remake="") == {"b": 1}
    assert without_checksum([1], "x.json", remake="") == [1]


@pytest.mark.parametrize(("old", "new"), [
    ('"a"', '"c"'), ("0.30000000000000004", "0.3"), ("null", "0"), ('"sha256": "', '"sha256": "0'),
    ('"name"', '"nome"'),
])
def test_an_altered_record_is_refused(tmp_path, old, new):
    path = tmp_path / "toy.json"
    save_record(path, Toy("a", 0.1 + 0.2))
    assert load_record(Toy, path, remake="make it again") == Toy("a", 0.1 + 0.2)
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=r"toy\.json: expected contents that fit their checksum.*make it again"):
        load_record(Toy, path, remake="make it again")
