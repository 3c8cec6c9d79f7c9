import json

import pytest

from mixpinn.anatomy import TOTAL_CLASSES, read_names
from mixpinn.anatomy.names import TOTAL_CLASSES_V1, is_lumbar, spine_rank, vertebrae_between
from mixpinn.base.errors import InputError

TABLE = {20: "vertebrae_L1", 21: "body"}


@pytest.mark.parametrize(("name", "text"), [
    ("a.json", json.dumps(TABLE)), ("bom.json", "\ufeff" + json.dumps(TABLE)),
    ("a.ctbl", "# Color table file\n0 background 0 0 0 0\n20 vertebrae_L1 1 2 3 255\n21 body 1 2 3 255\n"),
    ("a.tsv", "index\tname\tr\n20\tvertebrae_L1\t1\n21\tbody\t2\n"),
    ("a.csv", "name,label\nvertebrae_L1,20\nbody,21\n"),
    ("b.csv", "20;vertebrae_L1\r\n21;body\r\n"), ("float.csv", "index,name\n20.0,vertebrae_L1\n21.0,body\n"),
    ("snap.txt", '# ITK-SnAP\n0 0 0 0 0 0 0 "Clear Label"\n20 255 0 0 1 1 1 "vertebrae_L1"\n21 1 0 0 0.5 1 1 "body"\n'),
])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_formats(tmp_path, name, text, encoding):
    (tmp_path / name).write_bytes(text.encode(encoding))
    assert read_names(tmp_path / name) == TABLE


@pytest.mark.parametrize("text", [
    '{"labels": {"1": {"name": "L1"}}}', '{"L1": [1, 2]}', '{"31.5": "L1"}', "31,5\n20,21\n",
    "index,value,name\n1,31,L1\n", "index,name\n31,\n", "", "hello", "20\n21\n", "index,name\n1.5,a\n",
    "index,name\n1,a\n1,b\n", "[1, 2]", "\x00\x01",
])
def test_what_is_no_table_says_which_formats_are_taken(tmp_path, text):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(InputError, match=r"a\.txt"):
        read_names(tmp_path / "a.txt")


def test_a_number_that_is_named_twice_is_refused(tmp_path):
    (tmp_path / "names.json").write_text('{"31": "vertebrae_L1", "31": "vertebrae_L2"}')
    with pytest.raises(InputError, match="occurs twice"):
        read_names(tmp_path / "names.json")


def test_tables_by_name():
    assert read_names("total") == TOTAL_CLASSES
    assert read_names("total-v1") == TOTAL_CLASSES_V1
    published = {18: "vertebrae_L5", 22: "vertebrae_L1", 23: "vertebrae_T12", 41: "vertebrae_C1", 55: "small_bowel",
                 58: "rib_left_1", 81: "rib_right_12", 92: "sacrum", 93: "face", 104: "urinary_bladder"}
    assert len(TOTAL_CLASSES_V1) == len(set(TOTAL_CLASSES_V1.values())) == 104
    assert {number: TOTAL_CLASSES_V1[number] for number in published} == published


@pytest.mark.parametrize("name", ["L3", "l3", "vertebra_L3", "L3 vertebra", "vertebra L3"])
def test_other_spellings_of_a_vertebra(name):
    assert is_lumbar(name)
    assert spine_rank(name) == spine_rank("vertebrae_L3")


@pytest.mark.parametrize(("upper", "lower", "gap"), [
    ("L1", "L2", False), ("L1", "L3", True), ("T12", "L1", False), ("T11", "L1", True), ("T12", "L2", True),
    ("L5", "sacrum", False), ("L5", "S1", False), ("L3", "sacrum", True), ("C7", "T1", False), ("L6", "sacrum", False),
    ("S1", "sacrum", False),
])
def test_vertebrae_between(upper, lower, gap):
    assert vertebrae_between(spine_rank(upper), spine_rank(lower)) is gap
