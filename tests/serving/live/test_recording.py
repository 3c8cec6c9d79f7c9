"""Recordings keep answers to the last bit, stop where there is no room, and are played in their own time."""

import time

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.serving.live import LiveSession
from mixpinn.serving.live.export import save_series, save_table
from mixpinn.serving.live.recording import Recording, Replay
from serving.live.pressed import above


@pytest.fixture(scope="module")
def recorded(pressing):
    """Four answers, and the recording of them."""
    recording = Recording()
    with LiveSession(pressing) as session:
        session.record(recording)
        answers = [session.press(above(depth=1.0 + k)) for k in range(4)]
        session.record(None)
        session.press(above(depth=2.0))
    return answers, recording


def test_what_was_answered_comes_back(recorded) -> None:
    answers, recording = recorded
    assert len(recording) == 4
    for given, kept in zip(answers, recording, strict=True):
        assert_array_equal(given.answer.displacement, kept.answer.displacement)
        assert_array_equal(given.answer.force, kept.answer.force)
        assert (given.pose_id, given.time) == (kept.pose_id, kept.time)
    assert recording.seconds == answers[-1].time - answers[0].time


def test_without_room_it_says_so_and_the_session_goes_on(pressing) -> None:
    recording = Recording(most_bytes=2 * 12 * pressing.mesh.n_nodes)
    with LiveSession(pressing) as session:
        session.record(recording)
        for k in range(4):
            session.press(above(depth=1.0 + k))
        assert session.recording is None
    assert (len(recording), recording.full) == (2, True)


def test_a_replay_keeps_the_order_and_can_be_stopped(recorded) -> None:
    _, recording = recorded
    heard, ends = [], []
    replay = Replay(recording, heard.append, speed=20.0, finished=ends.append)
    assert replay.wait(30.0)
    assert [found.sequence for found in heard] == [found.sequence for found in recording]
    assert all(found.replayed for found in heard)
    assert ends == [4]
    slow = Replay(recording, lambda found: time.sleep(0.2), finished=ends.append)
    slow.stop()
    assert slow.wait(30.0)
    assert ends[1] < 4


def test_a_closed_recording_cannot_be_read(pressing) -> None:
    recording = Recording()
    with LiveSession(pressing) as session:
        session.record(recording)
        session.press(above())
    recording.close()
    with pytest.raises(InputError, match="closed"):
        recording[0]


def test_the_table_has_a_line_for_each_answer(recorded, pressing, tmp_path) -> None:
    answers, recording = recorded
    save_table(recording, tmp_path / "session.csv", mesh=pressing.mesh)
    lines = (tmp_path / "session.csv").read_text(encoding="utf-8").splitlines()
    columns = lines[0].split(",")
    force = [[float(line.split(",")[columns.index(f"force_{axis}")]) for axis in "xyz"] for line in lines[1:]]
    np.testing.assert_allclose(force, [found.answer.force[0] for found in answers], atol=1e-6)


def test_nothing_is_written_where_nothing_was_recorded(tmp_path) -> None:
    for name in ("session.pvd", "session.zip", "session.txt"):
        with pytest.raises(InputError):
            save_series([], tmp_path / name)
    assert not list(tmp_path.iterdir())
