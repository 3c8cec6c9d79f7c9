import json
from dataclasses import dataclass, field
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mixpinn.base.config import build_config, merge, parse_overrides, read_config_file
from mixpinn.base.errors import InputError
from mixpinn.pipeline import RunConfig


@dataclass(frozen=True)
class Inner:
    size: float = 1.0
    kind: Literal["a", "b"] = "a"
    seed: int = 0


@dataclass(frozen=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    named: dict[str, Inner] = field(default_factory=dict)
    names: tuple[str, ...] = ("x",)
    limit: int | None = None
    pair: tuple[float, float] = (0.0, 0.0)
    really: bool = False


def test_later_layers_win_and_nested_ones_are_merged():
    built = build_config(
        Outer, {"inner": {"size": 2, "kind": "b"}}, {"inner": {"size": 3.5}, "names": ["y", "z"]}, {"limit": None},
    )
    assert built == Outer(Inner(3.5, "b"), {}, ("y", "z"), None)


@pytest.mark.parametrize(("values", "says"), [
    ({"iner": {}}, "iner: expected one of inner, named, names, limit"),
    ({"inner": {"sise": 1}}, "inner.sise: expected one of size, kind, seed"),
    ({"inner": {"kind": "c"}}, "inner.kind: expected 'a' or 'b', got 'c'"),
    ({"inner": 3}, "inner"), ({"limit": "many"}, "limit"), ({"named": {"n": {"sise": 1}}}, "named.n.sise"),
])
def test_bad_settings_are_named(values, says):
    with pytest.raises(InputError) as caught:
        build_config(Outer, values)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_group_that_may_be_absent_is_so_by_the_word_none(tmp_path):
    (tmp_path / "run.toml").write_text('[simulation]\nrefinement = "none"\njoints = "none"\n')
    built = build_config(RunConfig, read_config_file(tmp_path / "run.toml"))
    assert built.simulation.refinement is None
    assert built.simulation.joints == "none"  # a word where words are meant stays one
    assert RunConfig().simulation.refinement is not None
    with pytest.raises(InputError, match=r"simulation\.protocol"):
        build_config(RunConfig, {"simulation": {"protocol": "none"}})


def test_seeds_are_not_negative():
    with pytest.raises(InputError, match=r"named\.a\.seed: expected 0 or more, got -1"):
        build_config(Outer, {"named": {"a": {"seed": -1}}})


@pytest.mark.parametrize("values", [
    {"inner": {"size": True}}, {"named": {"a": {"size": False}}}, {"limit": True}, {"pair": [1.0, True]},
])
def test_true_is_no_number(values):
    with pytest.raises(InputError, match=r"expected a number, got (?:true|false)"):
        build_config(Outer, values)
    assert build_config(Outer, {"really": True}).really


def test_overrides_are_json_or_text():
    assert parse_overrides(["a.b=2", "a.c=[1, 2]", "d=text", "e=x=y"]) == {
        "a": {"b": 2, "c": [1, 2]}, "d": "text", "e": "x=y",
    }
    with pytest.raises(InputError, match="KEY=VALUE"):
        parse_overrides(["a.b"])


TREES = st.recursive(
    st.integers(), lambda inner: st.dictionaries(st.sampled_from("abc"), inner, max_size=3), max_leaves=8,
)
MAPPINGS = st.dictionaries(st.sampled_from("abc"), TREES, max_size=3)


@given(MAPPINGS, MAPPINGS, MAPPINGS)
def test_merging_has_a_neutral_element_and_repeats_nothing(first, second, third):
    assert merge(first, {}) == merge({}, first) == merge(first, first) == first
    assert merge(merge(first, second), second) == merge(first, second)
    assert set(merge(merge(first, second), third)) == set(first) | set(second) | set(third)


def test_files_of_both_kinds(tmp_path):
    (tmp_path / "a.toml").write_text("title = 'Rücken'\n[inner]\nsize = 2.0", encoding="utf-8")
    (tmp_path / "a.json").write_text(json.dumps({"title": "Rücken", "inner": {"size": 2.0}}))
    assert read_config_file(tmp_path / "a.toml") == read_config_file(tmp_path / "a.json")


@pytest.mark.parametrize(("name", "content", "says"), [
    ("a.toml", b"[inner", "TOML"), ("a.json", b"{", "JSON"), ("a.json", b"[1]", "settings by name"),
    ("a.toml", b"\xff\xfe\x00", "decoded"),
    ("a.toml", b"a = \"C:\\data\"", "backslashes"), ("a.toml", b"\x00", "binary"),
])
def test_bad_files(tmp_path, name, content, says):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_config_file(tmp_path / name)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize(("name", "text"), [
    ("a.toml", '# Rücken\r\nseed = 1\r\n'), ("A.TOML", "# Rücken\nseed = 1\n"), ("a.JSON", '{"seed": 1}'),
    ("settings", "seed = 1"),
])
def test_files_as_editors_save_them(tmp_path, name, text, encoding):
    (tmp_path / name).write_bytes(text.encode(encoding))
    assert read_config_file(tmp_path / name) == {"seed": 1}
