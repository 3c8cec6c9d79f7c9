import os
import signal
import subprocess
import sys
import time

import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.lock import LOCK_FILE, acquire, locked, release

HOLD = "import sys, time; from mixpinn.base.lock import acquire; acquire(sys.argv[1]); print('held', flush=True); " \
    "time.sleep(float(sys.argv[2]))"


@pytest.fixture
def holder(tmp_path):
    """Begin a process that holds the lock on `tmp_path` for some seconds."""
    begun = []

    def hold(seconds):
        process = subprocess.Popen(
            [sys.executable, "-c", HOLD, tmp_path, str(seconds)], stdout=subprocess.PIPE, text=True,
        )
        begun.append(process)
        assert process.stdout.readline() == "held\n"
        return process

    yield hold
    for process in begun:
        process.kill()
        process.wait()
        process.stdout.close()


def test_second_process_is_refused_with_the_number_of_the_first(tmp_path, holder):
    process = holder(60)
    with pytest.raises(InputError, match=f"process {process.pid} "):
        acquire(tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_killed_process_leaves_no_lock(tmp_path, holder):
    process = holder(60)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert (tmp_path / LOCK_FILE).exists()
    with locked(tmp_path):
        assert (tmp_path / LOCK_FILE).read_text() == f"{os.getpid()}\n"
    assert not (tmp_path / LOCK_FILE).exists()


def test_waiting_ends_when_the_other_process_does(tmp_path, holder):
    holder(0.5)
    began = time.perf_counter()
    with locked(tmp_path, wait=True):
        assert time.perf_counter() - began < 30.0


def test_one_process_takes_it_as_often_as_it_likes(tmp_path):
    assert acquire(tmp_path / "new")
    assert not acquire(tmp_path / "new")
    with locked(tmp_path / "new"):
        pass
    assert (tmp_path / "new" / LOCK_FILE).exists()  # the inner one gave nothing back
    release(tmp_path / "new")
    release(tmp_path / "new")
    assert not list((tmp_path / "new").iterdir())
