"""A simulation that is killed goes on to the same results as one that was not."""

import os
import signal
import subprocess
import sys
import time

import numpy as np

from children import PATIENCE
from mixpinn.dataset import PoseState, SimulationStore
from pipeline.chain import done


def states(folder):
    return [status.state for status in SimulationStore.open(folder / "store").statuses()]


def test_killed_simulation_goes_on_bit_for_bit(chain, tmp_path):
    out = tmp_path / "out"
    words = [str(word) for word in chain.words("simulate", out=out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "mixpinn.cli", *words], start_new_session=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    deadline = time.monotonic() + PATIENCE
    while not list((out / "store" / "status").glob("*.json")):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    before = states(out)
    assert PoseState.DONE in before
    assert PoseState.MISSING in before
    kept = {
        path: path.stat().st_mtime_ns for path, state in zip(
            sorted((out / "store" / "status").glob("*.json")), before, strict=False,
        ) if state is PoseState.DONE
    }

    done(*words)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    resumed, whole = SimulationStore.open(out / "store"), SimulationStore.open(chain.simulation / "store")
    assert states(out) == [PoseState.DONE] * len(whole.poses)
    assert resumed.identity == whole.identity
    for pose in whole.poses:
        first, second = resumed.load(pose).arrays(), whole.load(pose).arrays()
        assert first.keys() == second.keys()
        for name in first.keys() - {"seconds"}:
            np.testing.assert_array_equal(first[name], second[name], err_msg=f"{pose.name} {name}")
    assert not list((out / "store").glob(".writing-*"))
