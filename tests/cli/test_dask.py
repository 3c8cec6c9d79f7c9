"""The same simulation on the workers of a Dask scheduler, one of which is killed half-way."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from children import PATIENCE
from mixpinn.dataset import PoseState, SimulationStore

distributed = pytest.importorskip("distributed")


def test_killed_dask_worker_loses_no_finished_pose_and_no_data(chain, tmp_path, drill):
    if not drill:
        pytest.skip("only in 'make drill': workers that die are tested in tests/dataset/test_dask_pool.py")
    out = tmp_path / "out"
    words = [str(word) for word in chain.words("simulate", out=out)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50,
    ) as cluster, distributed.Client(cluster) as client:
        pids = client.run(os.getpid)
        assert len(set(pids.values()) - {os.getpid()}) == 2  # processes of their own
        process = subprocess.Popen(
            [sys.executable, "-m", "mixpinn.cli", *words, "--scheduler", cluster.scheduler_address],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )
        deadline, status = time.monotonic() + PATIENCE, out / "store" / "status"
        while not list(status.glob("*.json")):
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        busy = [address for address, keys in client.processing().items() if keys]
        assert busy
        os.kill(pids[busy[0]], signal.SIGKILL)
        before = {path: path.stat().st_mtime_ns for path in status.glob("*.json")}
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, errors
    assert {path: path.stat().st_mtime_ns for path in before} == before  # nothing was made twice
    found, local = SimulationStore.open(out / "store"), SimulationStore.open(chain.simulation / "store")
    assert [entry.state for entry in found.statuses()] == [PoseState.DONE] * len(local.poses)
    for pose in local.poses:
        first, second = found.load(pose).arrays(), local.load(pose).arrays()
        for name in first.keys() - {"seconds"}:
            np.testing.assert_array_equal(first[name], second[name], err_msg=f"{pose.name} {name}")
