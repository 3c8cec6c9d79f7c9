"""A simulation that is killed again and again ends with the results of one that was left alone."""

import os
import signal
import subprocess
import sys
import time

import numpy as np

from mixpinn.dataset import SimulationStore
from pipeline.chain import done


def test_killed_at_any_moment(chain, drill, tmp_path):
    out = tmp_path / "out"
    words = [str(word) for word in chain.words("simulate", out=out)]
    rng = np.random.default_rng(1)
    for _ in range(40 if drill else 1):
        process = subprocess.Popen(
            [sys.executable, "-m", "mixpinn.cli", *words], start_new_session=True, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        time.sleep(rng.uniform(0.5, 9.0) if drill else 2.0)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    done(*words)
    resumed, whole = SimulationStore.open(out / "store"), SimulationStore.open(chain.simulation / "store")
    for pose in whole.poses:
        first, second = resumed.load(pose).arrays(), whole.load(pose).arrays()
        for name in first.keys() - {"seconds"}:
            np.testing.assert_array_equal(first[name], second[name], err_msg=f"{pose.name} {name}")
    assert not list((out / "store").glob(".writing-*"))
