"""Through the server and back: frames are the predictor's answers, orders do what they say."""

import io
import json
import threading
import time
import zipfile

import numpy as np
import pytest
import pyvista as pv
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.server.client import connect
from mixpinn.server.protocol import Flag, Kind
from mixpinn.serving.live import SkinPlacement
from mixpinn.serving.live.comparison import Setup, solve_fully
from serving.live.pressed import UP, above


@pytest.fixture
def client(server):
    with connect(server.url) as connected:
        yield connected


def test_the_scene_is_the_bundles(client, predictor) -> None:
    mesh, scene = predictor.mesh, client.scene
    assert scene["n_nodes"] == mesh.n_nodes
    assert [part["name"] for part in scene["parts"]] == list(mesh.rigid_names)
    points, triangles, nodes = client.surface(scene["skin"]["url"])
    assert_allclose(points, mesh.points[nodes], atol=1e-5)
    assert_array_equal(nodes[triangles], mesh.skin_faces)
    for k, part in enumerate(scene["parts"]):
        _, _, ids = client.surface(part["url"])
        assert set(ids) <= set(mesh.part_nodes(k + 1))
    assert scene["range"]["deepest"] == predictor.pose.domain.deepest
    assert "not calibrated" in " ".join(scene["warnings"])


def test_a_frame_is_the_predictors_answer(client, predictor) -> None:
    pose = above(depth=4.0)
    frame = client.press(pose.translation, rotation=pose.rotation)
    answer = predictor.press(pose.translation, rotation=pose.rotation)
    assert_array_equal(frame.displacement, answer.displacement)
    assert_allclose(frame.probes["force"][0], answer.force, rtol=1e-6)
    assert Flag.CONVERGED in frame.flags
    assert frame.kind is Kind.LIVE


def test_a_probe_is_put_onto_the_skin(client, predictor) -> None:
    point = [18.0, UP, 22.0]
    number = client.touch(point, depth=3.0, turn_deg=20.0, tilt_deg=(5.0, 0.0))
    frame = client.wait_for(number)
    pose = SkinPlacement(predictor.pose).place(point, depth=3.0, turn_deg=20.0, tilt_deg=(5.0, 0.0))
    assert_allclose(frame.probes["matrix"][0][:3, :3], pose.rotation, atol=1e-6)
    assert_allclose(frame.probes["matrix"][0][:3, 3], pose.translation, rtol=1e-6)
    assert_allclose(frame.probes["depth"], 3.0, atol=1e-5)


def test_choices_change_what_is_sent(client, predictor) -> None:
    client.say("set", vertices="skin", encoding="int16")
    frame = client.press(above().translation)
    assert len(frame.displacement) == len(np.unique(predictor.mesh.skin_faces))
    answer = predictor.press(above().translation)
    skin = np.unique(predictor.mesh.skin_faces)
    assert_allclose(frame.displacement, answer.displacement[skin], atol=0.51e-3)
    client.say("set", encoding="none")
    assert len(client.press(above(depth=2.0).translation).displacement) == 0


def test_bad_poses_are_refused_with_their_number(client) -> None:
    with pytest.raises(InputError, match="presses within"):
        client.press(above().translation, rotation=np.diag([1.0, -1.0, -1.0]))
    client.say("pose", id=77, tip=[0, 0, 0], rotation=[1.0] * 9)
    message = client.wait_for_message("error")
    assert (message["id"], message["code"]) == (77, "bad-pose")
    client.say("skin", id=78, point=[900.0, 0.0, 0.0], depth=2.0)
    message = client.wait_for_message("error")
    assert (message["id"], message["code"]) == (78, "refused")
    assert "point at the back" in message["text"]


def test_a_recording_is_played_and_saved(client, predictor) -> None:
    client.say("record", on=True)
    assert client.wait_for_message("recording")["on"]
    frames = [client.press(above(x=14.0 + i, depth=3.0).translation) for i in range(4)]
    client.say("record", on=False)
    said = client.wait_for_message("recording")
    assert (said["frames"], said["full"]) == (4, False)
    client.take_frames()
    client.say("replay", speed=20.0)
    assert client.wait_for_message("replayed")["frames"] == 4
    played = [frame for frame in client.take_frames() if frame.kind is Kind.REPLAY]
    for frame, again in zip(frames, played, strict=True):
        assert_array_equal(frame.displacement, again.displacement)
        assert_array_equal(frame.probes["force"], again.probes["force"])
    client.say("save", format="csv")
    said = client.wait_for_message("saved")
    table = client.fetch(said["url"]).decode().splitlines()
    assert len(table) == 5
    row = dict(zip(table[0].split(","), table[1].split(","), strict=True))
    assert float(row["force_y"]) == pytest.approx(frames[0].probes["force"][0, 1], abs=1e-5)
    client.say("save", format="pvd")
    archive = zipfile.ZipFile(io.BytesIO(client.fetch(client.wait_for_message("saved")["url"])))
    assert sum(name.endswith(".vtu") for name in archive.namelist()) == 4
    client.say("save", format="vtu")
    assert client.fetch(client.wait_for_message("saved")["url"]).startswith(b"<?xml")


def test_a_series_opens_as_one_data_set_over_time(client, tmp_path) -> None:
    client.say("record", on=True)
    frames = [client.press(above(depth=depth).translation) for depth in (2.0, 4.0)]
    client.say("save", format="pvd")
    said = client.wait_for_message("saved")
    zipfile.ZipFile(io.BytesIO(client.fetch(said["url"]))).extractall(tmp_path)
    reader = pv.get_reader(str(tmp_path / "recording.pvd"))
    assert len(reader.time_values) == 2
    reader.set_active_time_value(reader.time_values[1])
    assert_allclose(reader.read()[0].point_data["displacement"], frames[1].displacement, atol=1e-6)


def test_the_full_solution_is_that_of_the_solver(client, predictor) -> None:
    pose = above(depth=1.5)
    frame = client.press(pose.translation)
    client.say("compare")
    said = client.wait_for_message("comparison", "error", timeout=120.0)
    assert said["type"] == "comparison", said
    solved = solve_fully(Setup.of_predictor(predictor, [pose]))
    assert_allclose(said["force"]["full"], solved.force, atol=1e-6)
    apart = np.linalg.norm(frame.displacement - solved.displacement, axis=1)
    assert said["mean"] == pytest.approx(apart.mean(), rel=1e-3)
    beside = next(frame for frame in client.take_frames() if frame.kind is Kind.FULL_SOLUTION)
    assert_allclose(beside.displacement, solved.displacement, atol=1e-5)


def test_a_comparison_can_be_cancelled_and_another_one_begun(client) -> None:
    client.press(above(depth=3.0).translation)
    client.say("compare")
    client.say("compare")
    assert client.wait_for_message("error")["code"] == "busy"
    client.say("cancel")
    client.say("compare")
    client.say("ping", id=3)
    assert client.wait_for_message("error", "pong")["type"] == "pong"
    client.say("cancel")


def test_two_clients_press_bodies_of_their_own(server, predictor) -> None:
    with connect(server.url) as first, connect(server.url) as second:
        one, other = first.press(above(12.0).translation), second.press(above(28.0).translation)
        assert_array_equal(one.displacement, predictor.press(above(12.0).translation).displacement)
        assert_array_equal(other.displacement, predictor.press(above(28.0).translation).displacement)


def test_no_frame_is_stale_and_the_last_pose_is_answered(client) -> None:
    for k in range(300):
        number = client.move(above(x=15.0 + 0.01 * k).translation)
    last = client.wait_for(number)
    assert last.pose_id == number
    ids = [frame.pose_id for frame in client.take_frames()]
    assert ids == sorted(ids)
    assert len(ids) < 300


def test_a_client_that_reads_nothing_holds_up_nobody(server) -> None:
    import socket

    from websockets.sync.client import connect as raw

    slow = raw(server.url.replace("http", "ws") + "live", subprotocols=["mixpinn.live.1"], max_queue=1)
    slow.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    slow.send(json.dumps({"type": "hello", "version": 1, "encoding": "float32", "vertices": "nodes"}))
    stop = threading.Event()

    def flood() -> None:
        number = 0
        while not stop.is_set():
            number += 1
            try:
                slow.send(json.dumps({
                    "type": "pose", "id": number, "tip": above(x=15.0 + number % 7).translation.tolist(),
                    "rotation": np.eye(3).ravel().tolist(),
                }))
            except Exception:
                return
            time.sleep(0.002)

    thread = threading.Thread(target=flood)
    thread.start()
    with connect(server.url) as quick:
        delays = []
        for k in range(40):
            began = time.perf_counter()
            quick.press(above(x=12.0 + 0.1 * k).translation)
            delays.append(time.perf_counter() - began)
    stop.set()
    thread.join()
    slow.socket.close()
    assert np.median(delays) < 0.5


def test_the_next_file_may_be_ordered_as_soon_as_one_is_saved(client) -> None:
    client.press(above(depth=2.0).translation)
    for _ in range(8):
        client.say("save", format="vtu")
        assert client.wait_for_message("saved", "error")["type"] == "saved"
