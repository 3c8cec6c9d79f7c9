"""Configurations and the ablation table."""

import dataclasses

import pytest

from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.graph import Scaling
from mixpinn.networks import ABLATION, MIXPINN, MODELS, PHYSGNN, SIMPLE_GAT, ModelConfig


def test_thirteen_distinct_rows() -> None:
    assert list(ABLATION) == list(range(1, 14))
    assert len(set(ABLATION.values())) == 13
    assert all(row.layers == 8 and row.hidden == 128 for row in ABLATION.values())


def test_rows_by_the_columns_of_the_paper() -> None:
    def rows(condition) -> set[int]:
        return {number for number, row in ABLATION.items() if condition(row)}

    assert rows(lambda row: row.heads == 1) == {1}
    assert rows(lambda row: row.edge_features) == {3, 4, 5, 6, 7, 8}
    assert rows(lambda row: row.rel_weight == 1.0) == {4, 7, 8, 9, 12, 13}
    assert rows(lambda row: row.virtual_nodes) == {5, 7, 10, 12}
    assert rows(lambda row: row.virtual_edges) == {6, 8, 11, 13}


def test_named_models() -> None:
    assert SIMPLE_GAT is ABLATION[1]
    assert MIXPINN is ABLATION[10]
    assert MODELS["physgnn"] is PHYSGNN
    assert len(set(MODELS.values())) == 14


def test_widths() -> None:
    assert [MIXPINN.with_width(name).hidden for name in ("tiny", "desk", "authors", "paper")] == [8, 32, 128, 256]
    assert PHYSGNN.with_width("tiny") == PHYSGNN
    with pytest.raises(InputError, match="width"):
        MIXPINN.with_width("huge")


def test_read_from_plain_values_and_back() -> None:
    config = build_config(ModelConfig, dataclasses.asdict(MIXPINN), {"scaling": "standard", "hidden": 32})
    assert config == dataclasses.replace(MIXPINN, scaling=Scaling.STANDARD, hidden=32)


@pytest.mark.parametrize("bad", [{"layers": 0}, {"heads": 0}, {"hidden": -1}, {"rel_weight": float("nan")}])
def test_numbers_that_make_no_network(bad: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(bad))):
        ModelConfig(**bad)
