import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from children import PATIENCE, hear_interrupts
from dataset.dataset_fakes import SHORT, FakeScene, block, fake_runner, short_store
from mixpinn.base.errors import InputError
from mixpinn.dataset import GenerationSummary, Pose, PoseState, SimulationStore, generate
from mixpinn.dataset.local_pool import THREAD_VARIABLES, pinned_threads
from mixpinn.fem import scene_record

PATHS = os.pathsep.join([*map(str, Path(__file__).parents[:2]), os.environ.get("PYTHONPATH", "")])


def states(store):
    return [str(status.state) for status in store.statuses()]


@pytest.fixture
def log(tmp_path):
    (tmp_path / "log").mkdir()
    return tmp_path / "log"


def test_results_do_not_depend_on_the_number_of_workers(tmp_path, log):
    hashes = []
    for workers in (1, 2):
        scene = FakeScene(block(3), trouble={1: "raise", 2: "unconverged"})
        store = short_store(tmp_path / str(workers), scene)
        summary = generate(scene, store.poses, store, workers=workers, runner=fake_runner)
        assert (summary.done, summary.failed, summary.failed_steps) == (4, 2, 4)
        assert GenerationSummary.load(store.folder / "summary.json") == summary
        hashes.append([status.content_hash for status in store.statuses()])
    assert hashes[0] == hashes[1]
    assert store.status(store.poses[2]).reason == "SolveError: no equilibrium"


def test_dead_worker_costs_its_own_pose_one_attempt(tmp_path, log):
    scene = FakeScene(block(3), log=log, trouble={0: "die once", 1: "die"})
    store = short_store(tmp_path / "store", scene, protocol=replace(SHORT, rotations=(0.0,)))
    generate(scene, store.poses, store, workers=2, runner=fake_runner)
    assert states(store) == ["done", "failed", "done"]
    assert [store.status(pose).attempts for pose in store.poses] == [2, 2, 1]
    assert "died 2 times" in store.status(store.poses[1]).reason
    assert str(-signal.SIGKILL) in store.status(store.poses[1]).reason
    assert sorted(scene.runs()) == [*["pose_000_000"] * 2, *["pose_001_000"] * 2, "pose_002_000"]


def test_killed_generation_resumes_and_loses_the_pose_in_flight_only(tmp_path, log):
    folder = tmp_path / "store"
    code = (
        "import sys; from pathlib import Path; from dataset_fakes import *; from mixpinn.dataset import generate\n"
        "if __name__ == '__main__':\n"
        "    scene = FakeScene(block(3), log=Path(sys.argv[1]), trouble={1: 'end parent'})\n"
        "    store = short_store(Path(sys.argv[2]), scene)\n"
        "    generate(scene, store.poses, store, runner=fake_runner)\n"
    )
    script = tmp_path / "killed.py"
    script.write_text(code)
    environment = {**os.environ, "PYTHONPATH": PATHS}
    ended = subprocess.run([sys.executable, script, log, folder], env=environment, capture_output=True, check=False)
    assert ended.returncode == -signal.SIGKILL
    store = SimulationStore.open(folder)
    assert states(store) == ["done", "done", *["missing"] * 4]
    time.sleep(1.0)  # the orphaned worker notices at its next step that nobody listens
    assert states(store)[2] == "missing"

    scene = FakeScene(block(3), log=log)
    store = short_store(folder, scene)
    summary = generate(scene, store.poses, store, runner=fake_runner)
    assert summary.done == 6
    assert scene.runs() == [
        "pose_000_000", "pose_000_090", "pose_001_000", "pose_001_000", "pose_001_090", "pose_002_000", "pose_002_090",
    ]
    assert not list(folder.glob(".writing-*"))


def test_damaged_and_failed_poses_are_simulated_again(tmp_path, log):
    scene = FakeScene(block(3), trouble={1: "raise"})
    store = short_store(tmp_path / "store", scene)
    generate(scene, store.poses, store, runner=fake_runner)
    chunks = sorted(store.pose_folder(store.poses[4]).glob("displacement/c/**/*"))
    next(path for path in chunks if path.is_file()).unlink()
    (store.folder / ".writing-left").mkdir()
    again = FakeScene(block(3), log=log)
    generate(again, store.poses, store, runner=fake_runner, retry_failed=False)
    assert again.runs() == ["pose_002_000"]
    assert not (store.folder / ".writing-left").exists()
    assert states(store) == ["done", "done", "failed", "failed", "done", "done"]
    generate(again, store.poses, store, runner=fake_runner)
    assert states(store) == ["done"] * 6
    assert sorted(again.runs()) == ["pose_001_000", "pose_001_090", "pose_002_000"]


def interrupted(tmp_path, log, *lines):
    """The store of six poses whose simulation by these lines was interrupted in the second."""
    store = short_store(tmp_path / "store", FakeScene(block(3), log=log, pause=0.5))
    # In a process of its own: Control-C must not reach the one that runs the tests.
    script = (
        "import multiprocessing; from pathlib import Path; from dataset_fakes import *\n"
        "from mixpinn.dataset import SimulationsAhead, generate\n"
        "if __name__ == '__main__':\n"
        f"    scene = FakeScene(block(3), log=Path({str(log)!r}), pause=0.5)\n"
        f"    store = short_store(Path({str(store.folder)!r}), scene)\n"
        "    try:\n"
        + "".join(f"        {line}\n" for line in lines) +
        "    except KeyboardInterrupt:\n"
        "        print('interrupted', len(multiprocessing.active_children()))\n"
    )
    (tmp_path / "interrupted.py").write_text(script)
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "interrupted.py")], stdout=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=hear_interrupts, env={**os.environ, "PYTHONPATH": PATHS},
    )
    while not any(path.name.startswith("pose_000_090") for path in log.iterdir()):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=PATIENCE)
    assert output.split() == ["interrupted", "0"]
    return store


def test_interrupt_stops_all_workers_and_keeps_what_is_done(tmp_path, log):
    store = interrupted(tmp_path, log, "generate(scene, store.poses, store, runner=fake_runner)")
    assert states(store) == ["done", *["missing"] * 5]
    assert GenerationSummary.load(store.folder / "summary.json").done == 1


def test_thread_counts_are_pinned_and_restored(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with pinned_threads(2):
        assert {os.environ[name] for name in THREAD_VARIABLES} == {"2"}
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


@dataclass(frozen=True)
class Numerics:
    tolerance: float = 1e-6
    threads: int = 1


@dataclass(frozen=True, eq=False)
class OtherScene:
    mesh: object
    probe: object
    solver: Numerics
    table: np.ndarray


def test_scene_record_knows_what_matters():
    def identity(**changes):
        scene = FakeScene(block(3))
        values = {"mesh": scene.mesh, "probe": scene.probe, "solver": Numerics(), "table": np.arange(3)} | changes
        return scene_record(OtherScene(**values))

    assert identity() == identity(solver=Numerics(threads=8), mesh=block(4))
    assert identity() != identity(solver=Numerics(tolerance=1e-5))
    assert identity() != identity(table=np.arange(4))


def test_bad_requests_are_refused(tmp_path):
    scene = FakeScene(block(3))
    store = short_store(tmp_path, scene)
    with pytest.raises(InputError, match="workers"):
        generate(scene, store.poses, store, workers=0, runner=fake_runner)
    with pytest.raises(InputError, match="another folder"):
        generate(FakeScene(block(4)), store.poses, store, runner=fake_runner)
    with pytest.raises(InputError, match="poses of this store"):
        generate(scene, [Pose(99, (0.0, 0.0, 0.0), 0.0)], store, runner=fake_runner)
    with pytest.raises(InputError, match="scheduler"):
        generate(scene, store.poses, store, runner=fake_runner, scheduler="nonsense://")
    assert {status.state for status in store.statuses()} == {PoseState.MISSING}
