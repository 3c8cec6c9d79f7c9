"""A live session: answers are the predictor's, name their poses, and skip what is stale."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.serving import load_predictor
from mixpinn.serving.live import Friction, LiveAnswer, LiveSession, PressWorker, Refusal
from serving.live.pressed import above


def test_an_answer_is_the_predictors_and_names_its_pose(pressing) -> None:
    with LiveSession(pressing) as session:
        found = session.press(above(depth=4.0), pose_id=17)
    straight = pressing.press(above(depth=4.0).translation)
    assert found.pose_id == 17
    assert_array_equal(found.answer.displacement, straight.displacement)
    assert_array_equal(found.answer.force[0], straight.force)
    assert found.probes[0].depth == pytest.approx(4.0, abs=0.3)


def test_friction_goes_on_along_a_drag_and_forgets_when_told(pressing) -> None:
    way = [above(x=14.0 + i, depth=4.0) for i in range(5)]
    history, expected = None, []
    for pose in way:
        answer = pressing.press(pose.translation, rotation=pose.rotation, history=history)
        history = answer.history
        expected.append(answer.force)
    with LiveSession(pressing) as session:
        found = [session.press(pose) for pose in way]
        assert [answer.remembered for answer in found] == [False, True, True, True, True]
        assert_allclose([answer.answer.force[0] for answer in found], expected, atol=1e-9)
        session.forget()
        straight = session.press(way[-1])
        session.friction = Friction.STRAIGHT
        assert_array_equal(session.press(way[-1]).answer.force, straight.answer.force)
    alone = pressing.press(way[-1].translation).force
    assert_array_equal(straight.answer.force[0], alone)
    assert abs(expected[-1][0] - alone[0]) > 0.01  # dragged skin pulls back


def test_friction_remembers_nothing_of_an_answer_that_did_not_converge(pressing, monkeypatch) -> None:
    first, second = above(x=14.0, depth=4.0), above(x=16.0, depth=4.0)
    with LiveSession(pressing) as session:
        ask = session._ask

        def unsolved(probes, history):
            touch, remembered = ask(probes, history)
            return replace(touch, contact=replace(touch.contact, converged=False)), remembered

        with monkeypatch.context() as hard:
            hard.setattr(session, "_ask", unsolved)
            assert not session.press(first).answer.trust.converged
        found = session.press(second)
    assert not found.remembered
    assert_array_equal(found.answer.force[0], pressing.press(second.translation).force)


def test_a_drag_that_cannot_be_followed_is_given_up_for_the_straight_way(pressing, monkeypatch) -> None:
    with LiveSession(pressing) as session:
        session.press(above(x=14.0, depth=4.0))
        contact = session._hurried.contact
        monkeypatch.setattr(contact, "config", replace(contact.config, max_iterations=1))
        found = session.press(above(x=18.0, depth=4.0))
    assert not found.remembered
    assert found.answer.trust.converged
    assert_array_equal(found.answer.force[0], pressing.press(above(x=18.0, depth=4.0).translation).force)


def test_matrices_move_the_parts_as_the_field_does(pressing) -> None:
    with LiveSession(pressing) as session:
        found = session.press(above(depth=5.0))
    mesh = pressing.mesh
    for k, matrix in enumerate(found.matrices):
        nodes = mesh.part_nodes(k + 1)
        moved = mesh.points[nodes] @ matrix[:3, :3].T + matrix[:3, 3]
        assert_allclose(moved, mesh.points[nodes] + found.answer.displacement[nodes], atol=1e-4)


def test_two_probes_press_together_and_one_is_lifted(pressing) -> None:
    first, second = above(10.0, 10.0, 3.0), above(30.0, 30.0, 2.0)
    with LiveSession(pressing) as session:
        session.press(first, probe=0)
        both = session.press(second, probe=1)
        session.lift(0)
        one = session.press(second, probe=1)
        session.lift(1)
        last = session.press(first, probe=2)
    together = pressing.press(np.array([first.translation, second.translation]))
    assert_array_equal(both.answer.force, together.force)
    assert [probe.index for probe in both.probes] == [0, 1]
    assert_allclose(one.answer.force, pressing.press(second.translation).force[None], atol=1e-9)
    assert [probe.index for probe in last.probes] == [2]


def test_stale_poses_are_passed_over(pressing) -> None:
    worker, heard, hold = PressWorker(), [], threading.Event()
    with LiveSession(pressing, worker=worker) as session:
        session.press(above())

        def listener(found: LiveAnswer | Refusal) -> None:
            heard.append(found.pose_id)
            hold.wait(10.0)  # while the first is being delivered, ninety-nine come

        leave = session.listen(listener)
        for number in range(100, 200):
            session.move(above(depth=1.0 + number / 100.0), pose_id=number)
        hold.set()
        deadline = time.monotonic() + 20.0
        while heard[-1:] != [199] and time.monotonic() < deadline:
            time.sleep(0.01)
        leave()
    worker.close()
    assert heard[-1] == 199
    assert len(heard) <= 3
    assert heard == sorted(heard)


def test_nobody_waits_for_a_session_that_never_stops(pressing) -> None:
    worker = PressWorker()
    with LiveSession(pressing, worker=worker) as greedy, LiveSession(pressing, worker=worker) as modest:
        stop = threading.Event()

        def flood() -> None:
            while not stop.is_set():
                greedy.move(above(depth=3.0))

        thread = threading.Thread(target=flood)
        thread.start()
        answers = [modest.press(above(x=12.0 + i), timeout=20.0) for i in range(5)]
        stop.set()
        thread.join()
    worker.close()
    assert [answer.sequence for answer in answers] == [1, 2, 3, 4, 5]


def test_a_pose_without_sense_is_refused_and_the_next_one_answered(pressing) -> None:
    upside_down = ProbePose(np.diag([1.0, -1.0, -1.0]), above().translation)
    with LiveSession(pressing) as session:
        with pytest.raises(InputError, match="presses within"):
            session.press(upside_down)
        with pytest.raises(InputError, match="finite"):
            session.move(ProbePose(np.eye(3), np.array([np.nan, 0.0, 0.0])))
        with pytest.raises(InputError, match="index"):
            session.move(above(), probe=99)
        assert session.press(above()).answer.trust.converged


def test_an_unforeseen_error_is_told_and_the_session_goes_on(pressing, monkeypatch, caplog) -> None:
    with LiveSession(pressing) as session:
        with monkeypatch.context() as broken:
            broken.setattr(session, "_ask", lambda probes, history: 1 / 0)
            with pytest.raises(InputError, match="ZeroDivisionError"):
                session.press(above(depth=4.0))
        assert "could not be answered" in caplog.text
        found = session.press(above(depth=4.0))
    assert_array_equal(found.answer.displacement, pressing.press(above(depth=4.0).translation).displacement)


def test_a_listener_that_fails_silences_nobody(pressing) -> None:
    def fail(found: LiveAnswer | Refusal) -> None:
        raise RuntimeError("a listener's own fault")

    worker = PressWorker()
    with LiveSession(pressing, worker=worker) as first, LiveSession(pressing, worker=worker) as second:
        first.listen(fail)
        first.move(above(depth=4.0))
        found = second.press(above(depth=4.0))
    worker.close()
    assert_array_equal(found.answer.displacement, pressing.press(above(depth=4.0).translation).displacement)


def test_without_a_probe_nothing_moves(pressing) -> None:
    heard = []
    with LiveSession(pressing) as session:
        session.press(above())
        session.listen(heard.append)
        session.lift()
        deadline = time.monotonic() + 10.0
        while not heard and time.monotonic() < deadline:
            time.sleep(0.01)
    assert not heard[0].answer.displacement.any()
    assert heard[0].pose_id == 0


def test_networks_cannot_press(folder) -> None:
    with pytest.raises(InputError, match="cannot press"):
        LiveSession(load_predictor(folder))


def test_a_closed_session_says_so(pressing) -> None:
    session = LiveSession(pressing)
    session.close()
    with pytest.raises(InputError, match="closed"):
        session.move(above())
