import hashlib
import json
import os

import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.manifest import MANIFEST, Artefact, refuse_sealed

THING = Artefact("toy", 3, "make the toy again")


def flip(path, place=0):
    """Turn one bit around and leave size and time stamp as they were."""
    state, content = path.stat(), bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(bytes(content))
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns + 1))


@pytest.fixture
def toy(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.txt").write_text("alpha")
    (tmp_path / "sub" / "b.bin").write_bytes(bytes(range(256)))
    THING.seal(tmp_path, ["a.txt", "sub/b.bin"])
    return tmp_path


def test_manifest_tells_size_and_hash(toy):
    written = json.loads((toy / MANIFEST).read_text())
    assert (written["format"], written["version"]) == ("toy", 3)
    assert written["files"]["a.txt"] == {"size": 5, "sha256": hashlib.sha256(b"alpha").hexdigest()}
    THING.check(toy)
    THING.check(toy, "sub/b.bin")


@pytest.mark.parametrize("place", [0, 100, 255])
def test_a_flipped_bit_is_noticed_in_the_file_that_is_read(toy, place):
    flip(toy / "sub" / "b.bin", place)
    THING.check(toy, "a.txt")
    with pytest.raises(InputError, match=r"b\.bin: expected contents .* make the toy again"):
        THING.check(toy, "sub/b.bin")


def test_lost_short_and_unlisted_files_are_refused(toy):
    (toy / "c.txt").write_text("new")
    with pytest.raises(InputError, match="does not list"):
        THING.check(toy, "c.txt")
    assert not THING.lists(toy, "c.txt")
    THING.seal_more(toy, ["c.txt"])
    THING.check(toy)
    (toy / "a.txt").write_text("alph")
    with pytest.raises(InputError, match="expected 5 bytes, got 4"):
        THING.check(toy)
    (toy / "a.txt").unlink()
    with pytest.raises(InputError, match="no such file"):
        THING.check(toy)


def test_a_folder_that_is_not_there_is_not_taken_for_an_old_one(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        THING.check(tmp_path / "elsewhere")


def test_what_an_older_version_wrote_gets_one_line_with_the_remedy(toy):
    with pytest.raises(InputError, match="version 4, got a toy of version 3; ask for a new one"):
        Artefact("toy", 4, "ask for a new one").check(toy)
    with pytest.raises(InputError, match="a game of version 3, got a toy"):
        Artefact("game", 3, "").check(toy)
    (toy / MANIFEST).write_text('{"files": {"a.txt": 5}}')
    with pytest.raises(InputError, match="another layout"):
        THING.check(toy)
    (toy / MANIFEST).unlink()
    with pytest.raises(InputError, match="an older version wrote this") as caught:
        THING.check(toy)
    assert "\n" not in str(caught.value)


def test_no_output_is_written_over_what_a_manifest_vouches_for(toy):
    with pytest.raises(InputError, match="a file of a toy"):
        refuse_sealed(toy / "a.txt")
    refuse_sealed(toy / "c.txt")
    refuse_sealed(toy / "absent" / "a.txt")
    (toy / MANIFEST).write_text("{")
    refuse_sealed(toy / "a.txt")  # it vouches for nothing any more
