"""Workers that die or stop, while they start and while they work: the pose is tried again or reported, nobody waits."""

import multiprocessing
import os
import signal
import time
from dataclasses import replace

import pytest

from dataset.dataset_fakes import SHORT, FakeScene, Stubborn, block, fake_runner, short_store
from mixpinn.base.errors import InputError, MixpinnError
from mixpinn.dataset import PoseState, generate
from mixpinn.dataset.local_pool import run_local

TIMEOUT = 4.0
"""Generous for a runner that answers at once [s]."""
ONE_ROTATION = replace(SHORT, rotations=(0.0,))

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here")


@pytest.fixture
def marks(tmp_path):
    (tmp_path / "marks").mkdir()
    return tmp_path / "marks"


def simulate(store, scene, **settings):
    """All statuses of a run that must end, and leave no worker behind."""
    began = time.monotonic()
    list(run_local(store, scene, fake_runner, store.poses, workers=1, threads=1, **settings))
    assert time.monotonic() - began < 60.0
    assert not multiprocessing.active_children()
    return store.statuses()


def test_a_stopped_worker_costs_its_pose_one_attempt_and_then_the_pose(tmp_path, marks):
    scene = FakeScene(block(3), log=marks, trouble={0: "stop once", 1: "stop"})
    store = short_store(tmp_path / "store", scene, protocol=ONE_ROTATION)
    generate(scene, store.poses, store, workers=2, runner=fake_runner, timeout=TIMEOUT)
    found = store.statuses()
    assert not multiprocessing.active_children()
    assert [status.state for status in found] == [PoseState.DONE, PoseState.FAILED, PoseState.DONE]
    assert [status.attempts for status in found] == [2, 2, 1]
    assert "no step within 4 s" in found[1].reason
    assert len(found[1].reason.splitlines()) == 1


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_worker_that_ends_or_stops_while_it_starts_is_replaced(tmp_path, marks, number, drill):
    if number == signal.SIGKILL and not drill:
        pytest.skip("only in 'make drill': one that stops is noticed later, and replaced in the same way")
    scene = FakeScene(block(3))
    store = short_store(tmp_path / "store", scene, positions=1, protocol=ONE_ROTATION)
    found = simulate(store, Stubborn(scene, number, marks, times=1), timeout=TIMEOUT)
    assert [(status.state, status.attempts) for status in found] == [(PoseState.DONE, 1)]
    assert len(list(marks.iterdir())) == 2


def test_workers_that_never_start_end_the_run_in_one_line(tmp_path, marks):
    scene = FakeScene(block(3))
    store = short_store(tmp_path / "store", scene)
    with pytest.raises(MixpinnError, match="3 worker processes in a row could not start") as caught:
        simulate(store, Stubborn(scene, signal.SIGKILL, marks), timeout=TIMEOUT)
    assert len(str(caught.value).splitlines()) == 1
    assert len(list(marks.iterdir())) == 3
    assert not multiprocessing.active_children()
    with pytest.raises(MixpinnError, match="ImportError: no module named like this"):
        simulate(store, Stubborn(scene, "raise", marks), timeout=TIMEOUT)
    assert {status.state for status in store.statuses()} == {PoseState.MISSING}


def test_a_slow_pose_that_reports_its_steps_is_left_alone(tmp_path, marks):
    scene = FakeScene(block(3), pause=0.8)
    store = short_store(tmp_path / "store", scene, positions=1, protocol=ONE_ROTATION)
    found = simulate(store, scene, timeout=TIMEOUT)  # six steps, 4.8 s in all
    assert [(status.state, status.attempts) for status in found] == [(PoseState.DONE, 1)]


def test_stopping_early_ends_a_stopped_worker(tmp_path, marks):
    scene = FakeScene(block(3), log=marks, pause=0.2)
    store = short_store(tmp_path / "store", scene)
    events = run_local(store, scene, fake_runner, store.poses, workers=1, threads=1)
    next(events)
    worker, = multiprocessing.active_children()
    os.kill(worker.pid, signal.SIGSTOP)
    began = time.monotonic()
    events.close()
    assert time.monotonic() - began < 20.0
    assert not multiprocessing.active_children()


def test_a_timeout_without_sense_is_refused(tmp_path):
    scene = FakeScene(block(3))
    store = short_store(tmp_path, scene)
    for timeout in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="timeout"):
            generate(scene, store.poses, store, runner=fake_runner, timeout=timeout)
