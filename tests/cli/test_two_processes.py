"""A second process in a run directory is refused in one line, whatever the verb, and leaves it as it is."""

import os
import subprocess
import sys

import pytest

from pipeline.chain import command, contents

HOLD = "import sys; from mixpinn.base.lock import acquire; acquire(sys.argv[1]); print('held', flush=True); " \
    "sys.stdin.read()"


@pytest.fixture
def at_work(tmp_path):
    """A folder that another process works in, and the number of that process."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, tmp_path / "out"], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True,
    )
    assert process.stdout.readline() == "held\n"
    yield tmp_path / "out", process.pid
    process.communicate()


def test_every_verb_is_refused_in_a_folder_that_another_process_works_in(chain, at_work):
    out, process = at_work
    assert process != os.getpid()
    store = chain.simulation
    for words in (
        *(chain.words(stage, out=out) for stage in ("anatomy", "mesh", "simulate", "train")),
        ["evaluate", store, chain.model, "--out", out, "--no-pictures"],
        ["train", store, "--model", "hybrid", "--out", out], ["run", chain.settings("run"), "--out", out],
    ):
        outcome = command(*words)
        assert outcome.code == 2, words
        assert f"process {process} at work in it" in outcome.lines[-1], words
        assert "Traceback" not in outcome.err, words
        assert sorted(contents(out)) == [".lock"], words
