"""Scratch folders go away: at the end, after an error, and those of killed processes with the next one."""

import os
import signal
import subprocess
import sys

import pytest

from mixpinn.base import scratch_folder as module
from mixpinn.base.scratch_folder import scratch_folder

HOLD = (
    "import sys; from mixpinn.base.scratch_folder import scratch_folder\n"
    "with scratch_folder() as folder:\n    print(folder, flush=True); sys.stdin.read()"
)


@pytest.fixture(autouse=True)
def here(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(module.tempfile, "tempdir", None)
    monkeypatch.setattr(module, "_FRESH", -1.0)


def test_removed_at_the_end_and_after_an_error(tmp_path):
    with scratch_folder() as folder:
        (folder / "file").write_text("x")
        assert folder.parent == tmp_path
    with pytest.raises(RuntimeError), scratch_folder():
        raise RuntimeError
    assert not list(tmp_path.iterdir())


def test_what_a_killed_process_left_goes_with_the_next_and_what_lives_stays(tmp_path):
    alive, killed = (
        subprocess.Popen([sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    )
    folders = [process.stdout.readline().strip() for process in (alive, killed)]
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    assert all(map(os.path.isdir, folders))
    with scratch_folder():
        assert list(map(os.path.isdir, folders)) == [True, False]
    alive.communicate()
    assert not list(tmp_path.iterdir())
