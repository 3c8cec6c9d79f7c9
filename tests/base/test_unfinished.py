"""What killed writers left goes with the next write beside it; what is being written stays."""

import os
import signal
import subprocess
import sys

import pytest

from mixpinn.base import unfinished
from mixpinn.base.files import write_text

WRITES = (
    "import sys; from mixpinn.base.files import atomic_path\n"
    "with atomic_path(sys.argv[1]) as path:\n    path.write_text('x'); print('up', flush=True); sys.stdin.read()"
)

pytest.importorskip("fcntl", reason="no locks of the system here")


def test_of_killed_writers_nothing_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(unfinished, "_FRESH", -1.0)
    alive, killed = (
        subprocess.Popen(
            [sys.executable, "-c", WRITES, tmp_path / name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        ) for name in ("alive", "killed")
    )
    for process in (alive, killed):
        assert process.stdout.readline() == "up\n"
    os.kill(killed.pid, signal.SIGKILL)
    killed.communicate()
    assert len(list(tmp_path.glob(".writing-*"))) == 2
    write_text(tmp_path / "other", "y")
    assert len(list(tmp_path.glob(".writing-*"))) == 1
    alive.communicate()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"alive": "x", "other": "y"}
    assert alive.returncode == 0
