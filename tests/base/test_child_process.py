"""Processes that are stopped or deaf are ended all the same, and none outlives its parent."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mixpinn.base import child_process
from mixpinn.base.child_process import Patience, end_all

LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux ends processes with their parent")


class Child:
    """A process as `end_all` knows them."""

    def __init__(self, code):
        self.popen = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        assert self.popen.stdout.readline() == "up\n"
        self.terminate, self.kill = self.popen.terminate, self.popen.kill

    def join(self, timeout=None):
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.popen.wait(timeout)

    def is_alive(self):
        return self.popen.poll() is None


def is_running(number):
    """Whether there is such a process, apart from one that nobody has asked for its exit code."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{number}/status").read_text()
    except FileNotFoundError:
        return False


def test_stopped_and_deaf_processes_are_ended():
    wait = "import signal, time; {}; print('up', flush=True); time.sleep(60)"
    children = [
        Child(wait.format("pass")), Child(wait.format("signal.signal(signal.SIGTERM, signal.SIG_IGN)")),
        Child(wait.format("pass")),
    ]
    os.kill(children[2].popen.pid, signal.SIGSTOP)
    os.waitpid(children[2].popen.pid, os.WUNTRACED)  # until it has stopped
    began = time.monotonic()
    end_all(children, grace=0.5)
    assert time.monotonic() - began < 10.0
    assert [child.popen.returncode for child in children] == [-signal.SIGTERM, -signal.SIGKILL, -signal.SIGKILL]


@LINUX
def test_a_stopped_child_ends_with_its_parent():
    grandchild = (
        "import os, time; from mixpinn.base.child_process import end_with_parent; end_with_parent(os.getppid()); "
        "print(os.getpid(), flush=True); time.sleep(60)"
    )
    code = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {grandchild!r}]).wait()"
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    number = int(parent.stdout.readline())
    os.kill(number, signal.SIGSTOP)
    parent.kill()
    parent.communicate(timeout=20)  # the pipe ends when the grandchild is gone, too
    deadline = time.monotonic() + 10.0
    while is_running(number):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_silence_counts_only_while_somebody_listens(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(child_process.time, "monotonic", lambda: now[0])
    patience = Patience(10.0)

    def after(seconds, *who):
        now[0] += seconds
        return patience.lost(dict.fromkeys(who, 10.0))

    assert patience.tick == 1.0
    assert not after(1000.0, "a", "b")  # this process itself was suspended
    for _ in range(8):
        assert not after(1.0, "a", "b")
    patience.heard("b")
    assert after(1.0, "a", "b") == ["a"]
    assert after(1.0, "b") == []
    assert not after(1.0, "a", "b")  # it was not waited for meanwhile
    now[0] += 2.0
    assert patience.lost({"a": 1.0, "b": 100.0}) == ["a"]
