import os
import signal
import sys
import time

import numpy as np
import pytest

from mixpinn.base import reader_process
from mixpinn.base.reader_process import read_apart

# The child imports these from this module.


def doubled(path):
    print("libraries talk")
    return {"twice": 2.0 * np.loadtxt(path)}, {"pid": os.getpid()}


def crashing(path):
    os.kill(os.getpid(), signal.SIGSEGV)


def raising(path):
    raise KeyError("nothing\nthere")


def leaving(path):
    sys.exit(3)


def hungry(path):
    return {"zeros": np.zeros(1 << 30)}, None


def busy(path):
    while True:
        time.monotonic()


def hanging(path):
    time.sleep(60.0)


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    reader_process._end()
    path = tmp_path / "numbers.txt"
    path.write_text("1 2 3\n")
    yield path
    reader_process._end()


def test_one_child_reads_file_after_file(file):
    arrays, about = read_apart(doubled, file)
    np.testing.assert_array_equal(arrays["twice"], [2.0, 4.0, 6.0])
    assert about["pid"] != os.getpid()
    assert read_apart(doubled, file)[1] == about


@pytest.mark.parametrize(("reader", "says"), [
    (crashing, "SIGSEGV"), (raising, "KeyError: 'nothing.*there'"), (leaving, "SystemExit: 3"), (hungry, "MemoryError"),
])
def test_what_goes_wrong_there_is_one_line_here(file, reader, says):
    for _ in range(2):
        with pytest.raises(ValueError, match=says) as caught:
            read_apart(reader, file)
        assert "\n" not in str(caught.value)
    assert read_apart(doubled, file)[0]["twice"][0] == 2.0


def test_what_does_not_end_is_ended(file, monkeypatch):
    monkeypatch.setattr(reader_process, "_SECONDS", 0.5)
    with pytest.raises(ValueError, match="processor time"):
        read_apart(busy, file)
    monkeypatch.setattr(reader_process, "_WAIT", -59.0)  # 30 s in all, less these
    with pytest.raises(ValueError, match="no end of reading within"):
        read_apart(hanging, file)
    assert reader_process._child == {}


def test_the_child_ends_with_its_parent(file):
    _, about = read_apart(doubled, file)
    reader_process._end()
    with pytest.raises(ProcessLookupError):
        os.kill(about["pid"], 0)
