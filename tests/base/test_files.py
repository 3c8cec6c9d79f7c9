import errno
import os

import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.files import NO_ROOM, atomic_path, make_folder, read_json, write_json, write_text


def test_file_is_renamed_when_it_is_whole(tmp_path):
    with atomic_path(tmp_path / "a" / "b.vtu") as temporary:
        assert temporary.suffix == ".vtu"
        temporary.write_text("new")
        assert not (tmp_path / "a" / "b.vtu").exists()
    assert (tmp_path / "a" / "b.vtu").read_text() == "new"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b.vtu"]


def test_error_keeps_what_was_there(tmp_path):
    write_text(tmp_path / "a.txt", "old")

    def write_half():
        with atomic_path(tmp_path / "a.txt") as temporary:
            temporary.write_text("ne")
            raise ValueError("half")

    with pytest.raises(ValueError, match="half"):
        write_half()
    assert (tmp_path / "a.txt").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("number", [*NO_ROOM, None])
def test_no_room_is_said_in_one_line(tmp_path, number):
    with pytest.raises(InputError, match="room to write") as caught, atomic_path(tmp_path / "a.txt"):
        raise OSError(number, os.strerror(number)) if number else OSError("the writer failed")
    assert "a.txt" in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_other_errors_of_the_system_are_not_disguised(tmp_path):
    with pytest.raises(ConnectionResetError), atomic_path(tmp_path / "a.txt"):
        raise OSError(errno.ECONNRESET, "reset")


@pytest.mark.parametrize("below", ["", "below", "below/further"])
def test_file_in_the_way_of_a_folder(tmp_path, below):
    (tmp_path / "file").write_text("precious")
    with pytest.raises(InputError, match="existing file"):
        make_folder(tmp_path / "file" / below)


def test_folder_in_the_way_of_a_file(tmp_path):
    (tmp_path / "a.json").mkdir()
    with pytest.raises(InputError, match="got a folder"):
        write_json(tmp_path / "a.json", {})
    with pytest.raises(InputError, match=r"a\.json"):
        read_json(tmp_path / "a.json")
