"""For robots and learners: many poses at once, the depth that feels a force, how the wrench changes with the pose."""

from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError, SolveError
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.serving import many_poses
from mixpinn.serving.forked_poses import FEWEST, may_fork, predict_forked
from mixpinn.serving.many_poses import press_many
from serving.live.pressed import UP, above, block_predictor


@pytest.fixture(scope="module")
def pressing():
    return block_predictor()


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_many_poses_are_answered_as_one_is(pressing, threads) -> None:
    rng = np.random.default_rng(threads)
    tips = np.array([above(x, z, d).translation for x, z, d in rng.uniform([10, 10, 0.5], [30, 30, 5.0], (12, 3))])
    turns = probe_rotation(rng.uniform(0.0, 180.0, 12))
    many = pressing.press_many(tips, rotations=turns, threads=threads)
    for tip, turn, found in zip(tips, turns, many, strict=True):
        alone = pressing.press(tip, rotation=turn)
        assert_array_equal(found.displacement, alone.displacement)
        assert_array_equal(found.force, alone.force)
        assert found.trust == alone.trust


def test_processes_answer_as_one_does_and_name_the_pose_that_is_refused(pressing) -> None:
    if not may_fork(1000, 2):
        pytest.skip("other threads run, or the system is no Linux: threads share the poses instead")
    rng = np.random.default_rng(0)
    places = rng.uniform([10, 10, 0.5], [30, 30, 5.0], (2 * FEWEST, 3))
    tips, turn = np.array([above(x, z, d).translation for x, z, d in places]), probe_rotation(30.0)
    begin = pressing.press(tips[0], rotation=turn).history
    turns = np.tile(turn, (len(tips), 1, 1))
    for history in (None, begin):
        many = predict_forked(pressing.pose, tips, turns, history=history, workers=2)
        for tip, found in zip(tips, many, strict=True):
            alone = pressing.press(tip, rotation=turn, history=history)
            assert_array_equal(found.displacement, alone.displacement)
            assert_array_equal(found.wrench[0, :3], alone.force)
            assert found.trust == alone.trust
    tips[-1] = np.nan
    with pytest.raises(InputError, match=rf"pose {len(tips) - 1}: .*finite"):
        predict_forked(pressing.pose, tips, turns, history=None, workers=2)
    with pytest.raises(InputError, match=rf"pose {len(tips) - 1}: .*finite"):
        press_many(pressing, tips, rotations=turns)


def test_a_process_that_is_ended_leaves_the_work_to_threads(pressing, monkeypatch) -> None:
    def ended(*_: object, **__: object) -> list[object]:
        raise BrokenProcessPool

    monkeypatch.setattr(many_poses, "may_fork", lambda *_: True)
    monkeypatch.setattr(many_poses, "predict_forked", ended)
    tips = np.array([above(20.0, 20.0, depth).translation for depth in (1.0, 2.0)])
    many = press_many(pressing, tips)
    assert [float(found.force[1]) for found in many] == [float(pressing.press(tip).force[1]) for tip in tips]


def test_a_pose_that_is_refused_is_named(pressing) -> None:
    tips = np.array([above().translation, [np.nan, 0.0, 0.0]])
    with pytest.raises(InputError, match=r"pose 1: .*finite"):
        pressing.press_many(tips)
    with pytest.raises(InputError, match="use press"):
        pressing.press_many(above().translation)
    assert pressing.press_many(np.zeros((0, 3))) == []


@pytest.mark.parametrize("share", [0.1, 0.4, 0.9])
@pytest.mark.parametrize("tilt", [0.0, 8.0])
def test_the_depth_feels_the_force(pressing, share, tilt) -> None:
    direction = (np.sin(np.deg2rad(tilt)), -np.cos(np.deg2rad(tilt)), 0.0)
    line = above(18.0, 22.0, -5.0).translation
    deepest = pressing.pose.domain.deepest
    turn = probe_rotation(0.0, direction)
    beyond = pressing.pose.contact.depth(pressing.pose.probes[:1], turn[None], line[None])[0]
    most = pressing.press(line + (deepest - beyond) * (turn @ [0.0, -1.0, 0.0]), rotation=turn)
    wanted = share * float(np.linalg.norm(most.force))
    found = pressing.depth_for(wanted, line, direction=direction)
    assert found.solves <= 5
    again = pressing.press(found.tip, rotation=found.rotation)
    assert np.linalg.norm(again.force) == pytest.approx(wanted, abs=0.1)
    assert found.force == pytest.approx(np.linalg.norm(again.force), rel=1e-12)
    reached = pressing.pose.contact.depth(pressing.pose.probes[:1], found.rotation[None], found.tip[None])
    assert reached[0] == pytest.approx(found.depth, abs=1e-9)


def test_forces_out_of_reach_are_refused_with_the_range(pressing) -> None:
    line = above().translation
    with pytest.raises(InputError, match=r"expected 0 to \d+\.\d N"):
        pressing.depth_for(1e5, line)
    with pytest.raises(InputError, match="more than 0 N"):
        pressing.depth_for(-1.0, line)
    with pytest.raises(InputError, match="over the back"):
        pressing.depth_for(1.0, [500.0, UP, 0.0])


@pytest.mark.parametrize("remembered", [False, True])
@pytest.mark.parametrize("place", [(19.0, 21.0, 4.0), (15.0, 25.0, 2.5), (24.0, 18.0, 5.0), (21.0, 27.0, 3.3)])
def test_the_stiffness_is_that_of_other_central_differences(pressing, remembered, place) -> None:
    pose = above(*place)
    history = pressing.press(pose.translation).history if remembered else None
    found = pressing.stiffness(pose.translation, history=history)

    def wrench(shift, vector):
        answer = pressing.press(
            pose.translation + shift, rotation=rotation_from_vector(np.array(vector)), history=history,
        )
        return np.concatenate([answer.force, answer.moment])

    step, nothing = 0.05, np.zeros(3)
    here = wrench(nothing, nothing)
    ahead = np.array([*(wrench(step * e, nothing) - here for e in np.eye(3)),
                      *(wrench(nothing, 0.05 * step * e) - here for e in np.eye(3))]).T
    behind = np.array([*(here - wrench(-step * e, nothing) for e in np.eye(3)),
                       *(here - wrench(nothing, -0.05 * step * e) for e in np.eye(3))]).T
    ahead /= np.repeat([step, 0.05 * step], 3)
    behind /= np.repeat([step, 0.05 * step], 3)
    compared = 0
    # Rows and columns have units of their own: each block is measured by its own largest entry.
    for rows in (slice(0, 3), slice(3, 6)):
        for columns in (slice(0, 3), slice(3, 6)):
            one, other, mine = ahead[rows, columns], behind[rows, columns], found[rows, columns]
            largest = np.abs(0.5 * (one + other)).max()
            smooth = (np.abs(one - other) < 0.03 * largest).all(axis=0)  # contact does not switch along this axis
            assert_allclose(mine[:, smooth], 0.5 * (one + other)[:, smooth], atol=0.03 * largest)
            compared += int(smooth.sum())
    assert compared >= 3


def test_pressing_deeper_pushes_back_harder(pressing) -> None:
    found = pressing.stiffness(above().translation)
    assert found[1, 1] < 0.0  # along −y the force on the probe, +y, grows


def test_a_stiffness_of_answers_that_did_not_converge_is_refused(pressing, monkeypatch) -> None:
    press, asked = pressing.press, []

    def one_unsolved(*args, **named):
        answer = press(*args, **named)
        asked.append(answer)
        return replace(answer, trust=replace(answer.trust, converged=len(asked) != 7))

    monkeypatch.setattr(pressing, "press", one_unsolved)
    with pytest.raises(SolveError, match="1 of 12 poses"):
        pressing.stiffness(above().translation, threads=1)
