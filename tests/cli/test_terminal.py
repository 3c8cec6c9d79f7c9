"""What a terminal or a scheduler does to a command: signals, encodings."""

import os
import signal
import subprocess
import sys
import time

import pytest

from children import PATIENCE, hear_interrupts


def start(*words, **environment):
    return subprocess.Popen(
        [sys.executable, "-m", "mixpinn.cli", *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        start_new_session=True, preexec_fn=hear_interrupts, env={**os.environ, **environment},
    )


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_help_in_any_encoding(encoding):
    process = start("train", "--help", PYTHONIOENCODING=encoding)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert b"--out" in out


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_in_one_line_and_no_unused_run(tmp_path, number, code):
    out = tmp_path / "run"
    process = start("demo", "--out", out)
    deadline = time.monotonic() + PATIENCE
    while not (out / "run.json").exists() and not (out / "anatomy").exists():
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.killpg(process.pid, number)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == code, err
    assert b"Traceback" not in err
    assert err.decode(errors="replace").splitlines()[-1] == "mixpinn: stopped; the same command goes on from here"
