import json

import pytest

from mixpinn.anatomy import TOTAL_CLASSES, read_names
from mixpinn.anatomy.names import is_lumbar, spine_rank, unknown_structure
from mixpinn.base.errors import InputError


def test_total_classes_are_those_published_for_version_2():
    # Read from the published class map, in places spread over all of it.
    published = {
        1: "spleen", 2: "kidney_right", 7: "pancreas", 9: "adrenal_gland_left", 12: "lung_upper_lobe_right",
        23: "kidney_cyst_left", 25: "sacrum", 26: "vertebrae_S1", 27: "vertebrae_L5", 28: "vertebrae_L4",
        29: "vertebrae_L3", 30: "vertebrae_L2", 31: "vertebrae_L1", 32: "vertebrae_T12", 43: "vertebrae_T1",
        44: "vertebrae_C7", 50: "vertebrae_C1", 51: "heart", 58: "common_carotid_artery_left",
        64: "portal_vein_and_splenic_vein", 69: "humerus_left", 78: "hip_right", 79: "spinal_cord",
        86: "autochthon_left", 91: "skull", 92: "rib_left_1", 104: "rib_right_1", 115: "rib_right_12",
        117: "costal_cartilages",
    }
    assert len(TOTAL_CLASSES) == len(set(TOTAL_CLASSES.values())) == 117
    assert {number: TOTAL_CLASSES[number] for number in published} == published


def test_spine_runs_from_neck_to_tail():
    spine = ["vertebrae_C1", "vertebrae_C7", "vertebrae_T1", "vertebrae_T12", "vertebrae_L1", "vertebrae_L6",
             "vertebrae_S1", "sacrum", "coccyx"]
    ranks = [spine_rank(name) for name in spine]
    assert None not in ranks
    assert ranks == sorted(set(ranks))
    assert spine_rank("liver") is None


def test_lumbar():
    assert is_lumbar("vertebrae_L3")
    assert not is_lumbar("vertebrae_T12")
    assert not is_lumbar("vertebrae_L3_old")


@pytest.mark.parametrize("table", [
    {"1": "body", "2": "vertebrae_L1"}, {"body": 1, "vertebrae_L1": 2},
    {"labels": {"background": 0, "body": 1, "vertebrae_L1": 2}},
])
def test_name_tables(tmp_path, table):
    path = tmp_path / "names.json"
    path.write_text(json.dumps(table))
    assert read_names(path) == {1: "body", 2: "vertebrae_L1"}


@pytest.mark.parametrize("table", [[], {}, {"one": "body"}, {"1": "a", "2": "a"}, {"a": 1, "b": 1}, {"-1": "a"}, 3])
def test_bad_name_tables(tmp_path, table):
    path = tmp_path / "names.json"
    path.write_text(json.dumps(table))
    with pytest.raises(InputError, match=r"names\.json"):
        read_names(path)


def test_unknown_structure_suggests_close_names():
    error = unknown_structure("vertebra_L1", ["vertebrae_L1", "liver"], where="the folder")
    assert "did you mean vertebrae_L1" in str(error)
    assert "liver" in str(unknown_structure("zzz", ["liver"], where="the folder"))
