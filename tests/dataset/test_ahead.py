import time

import pytest

from children import PATIENCE
from dataset.dataset_fakes import FakeScene, block, fake_runner, short_store
from dataset.test_generation import interrupted, states
from mixpinn.base.errors import InputError
from mixpinn.dataset import GenerationSummary, PoseState, SimulationsAhead, build_sample_table, generate


@pytest.fixture
def log(tmp_path):
    (tmp_path / "log").mkdir()
    return tmp_path / "log"


def done(store, poses):
    return [store.status(pose).state is PoseState.DONE for pose in poses]


def test_later_poses_are_simulated_while_earlier_ones_are_used(tmp_path, log):
    scene = FakeScene(block(3), log=log, pause=0.2)
    store = short_store(tmp_path / "store", scene)
    with SimulationsAhead(scene, store.poses, store, runner=fake_runner) as ahead:
        ahead.wait(store.poses[:2])
        assert done(store, store.poses[:2]) == [True, True]
        until = time.monotonic() + PATIENCE
        while store.status(store.poses[2]).state is not PoseState.DONE:  # nobody asks for it yet
            assert time.monotonic() < until
            time.sleep(0.02)
        ahead.wait(store.poses[2:])
    assert states(store) == ["done"] * 6
    assert GenerationSummary.load(store.folder / "summary.json").done == 6


def test_results_and_tables_are_those_of_rounds_one_after_another(tmp_path):
    scene = FakeScene(block(3), trouble={1: "raise", 2: "unconverged"})
    apart, ahead = (short_store(tmp_path / name, scene) for name in ("apart", "ahead"))
    generate(scene, apart.poses[:4], apart, runner=fake_runner)
    before = build_sample_table(apart)
    with SimulationsAhead(scene, ahead.poses, ahead, workers=2, runner=fake_runner) as running:
        running.wait(ahead.poses[:4])
        running.wait(ahead.poses[4:])
        now = build_sample_table(ahead, poses=ahead.poses[:4])
    assert now.position_index.tolist() == before.position_index.tolist()
    assert (now.displacement == before.displacement).all()
    generate(scene, apart.poses, apart, runner=fake_runner, retry_failed=False)
    assert [s.content_hash for s in ahead.statuses()] == [s.content_hash for s in apart.statuses()]
    assert ahead.status(ahead.poses[2]).reason == "SolveError: no equilibrium"


def test_what_is_there_already_is_not_waited_for(tmp_path, log):
    scene = FakeScene(block(3), log=log)
    store = short_store(tmp_path / "store", scene)
    generate(scene, store.poses[:3], store, runner=fake_runner)
    with SimulationsAhead(scene, store.poses, store, runner=fake_runner) as ahead:
        ahead.wait(store.poses[:3])
        ahead.wait(store.poses)
    assert sorted(scene.runs()) == sorted(pose.name for pose in store.poses)


def test_errors_reach_whoever_waits_or_leaves(tmp_path, monkeypatch):
    scene = FakeScene(block(3))
    store = short_store(tmp_path / "store", scene)
    with pytest.raises(InputError, match="at least 1"):
        SimulationsAhead(scene, store.poses, store, workers=0)

    def full(*_, **__):
        raise InputError("store", expected="room", got="a full disk", fix="make room")

    monkeypatch.setattr("mixpinn.dataset.ahead.run_poses", full)

    def use(*, waits):
        with SimulationsAhead(scene, store.poses, store, runner=fake_runner) as ahead:
            if waits:
                ahead.wait(store.poses)

    for waits in (True, False):
        with pytest.raises(InputError, match="a full disk"):
            use(waits=waits)


def test_leaving_early_ends_the_workers(tmp_path, log):
    store = interrupted(
        tmp_path, log, "with SimulationsAhead(scene, store.poses, store, runner=fake_runner) as ahead:",
        "    ahead.wait(store.poses)",
    )
    assert states(store)[0] == "done"
    assert "missing" in states(store)
