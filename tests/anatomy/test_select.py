import pytest

from mixpinn.anatomy.images.image_file import structure_name
from mixpinn.anatomy.select import check_roles, select_files
from mixpinn.base.errors import InputError

from .builders import masks, write_folder


def test_structure_name(tmp_path):
    assert structure_name(tmp_path / "vertebrae_L1.nii.gz") == structure_name(tmp_path / "vertebrae_L1.nii")


def test_files_by_role(tmp_path):
    selection = select_files(write_folder(tmp_path), rigid=["vertebrae_L2"], soft=["vertebrae_L1"])
    assert set(selection.files()) == set(masks())
    assert list(selection.rigid) == ["vertebrae_L2"]
    assert list(selection.soft) == ["vertebrae_L1"]


@pytest.mark.parametrize(("names", "chosen"), [
    (["body", "body_trunc", "body_extremities"], "body_trunc"), (["body", "body_extremities"], "body"),
    (["body", "body_trunc_smooth"], "body_trunc_smooth"), (["torso"], "torso"),
])
def test_body_is_found_by_name(tmp_path, names, chosen):
    structures = masks()
    body = structures.pop("body_trunc")
    write_folder(tmp_path, structures | dict.fromkeys(names, body))
    assert structure_name(select_files(tmp_path).body) == chosen


def refuses(expected, function, *args, **kwargs):
    with pytest.raises(InputError) as caught:
        function(*args, **kwargs)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bad_folders(tmp_path):
    refuses("no such folder", select_files, tmp_path / "absent")
    empty = tmp_path / "empty"
    empty.mkdir()
    refuses("an empty folder", select_files, empty)
    structures = masks()
    refuses("a body", select_files, write_folder(
        tmp_path / "no_body", {name: mask for name, mask in structures.items() if name != "body_trunc"}))
    refuses("lumbar", select_files, write_folder(tmp_path / "no_spine", {"body": structures["body_trunc"]}))
    two = {"body_trunc_a": structures["body_trunc"], "body_trunc_b": structures["body_trunc"]}
    refuses("body_trunc_a, body_trunc_b", select_files, write_folder(tmp_path / "two", two))


def test_bad_choices(tmp_path):
    folder = write_folder(tmp_path)
    refuses("did you mean vertebrae_L1", select_files, folder, rigid=["vertebra_L1"])
    refuses("did you mean body_trunc", select_files, folder, body="body_trunk")
    refuses("twice", select_files, folder, soft=["vertebrae_L1"])
    refuses("at least one", select_files, folder, rigid=[])


def test_more_structures_than_labels():
    refuses("at most 255", check_roles, "body", [], [str(i) for i in range(255)])
