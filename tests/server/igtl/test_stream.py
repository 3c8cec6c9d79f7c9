"""Poses in, answers out: to several peers, to slow ones, to hostile ones, and again after they were killed."""

import asyncio
import contextlib
import json
import socket
import struct
import threading

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.server.igtl.connect import address, call, listen
from mixpinn.server.igtl.header import Header
from mixpinn.server.igtl.image import ImageBody
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.ndarray import NdarrayBody
from mixpinn.server.igtl.polydata import PolyDataBody
from mixpinn.server.igtl.publisher import Publisher
from mixpinn.server.igtl.ras import RasFrame
from mixpinn.server.igtl.status import StatusBody, StatusCode
from mixpinn.server.igtl.stream import Stream, StreamConfig
from mixpinn.server.igtl.string import StringBody
from mixpinn.server.igtl.transform import TransformBody
from mixpinn.serving.live import Friction, LiveSession
from mixpinn.serving.motions import motion_matrices
from server.igtl.line import Line, process
from serving.live.pressed import above, block_predictor


@pytest.fixture(scope="module")
def predictor():
    made, pose = block_predictor(), above()
    made.press(pose.translation, rotation=pose.rotation)  # compiled before the clock runs
    return made


@contextlib.asynccontextmanager
async def _serving(predictor, config=None, publisher=None):
    """A stream that listens; its port."""
    session = LiveSession(predictor, friction=Friction.STRAIGHT)
    found = asyncio.get_running_loop().create_future()
    async with Stream(session, publisher or Publisher(predictor.mesh), config) as stream:
        task = asyncio.create_task(listen(stream, "127.0.0.1", 0, ready=found.set_result))
        try:
            yield await found
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
            session.close()


def test_a_pose_is_answered_with_the_prediction_in_ras(predictor):
    publisher, pose, now = Publisher(predictor.mesh), above(depth=4.0), 123456789 << 32 | 77

    async def play():
        async with _serving(predictor) as port:
            line = await Line.to(port)
            line.move(publisher, pose, now)
            sent = {}
            for kind, device in [("TRANSFORM", "L1"), ("TRANSFORM", "L2"), ("NDARRAY", "Force"), ("STRING", "Trust"),
                                 ("POLYDATA", "Skin")]:
                sent[device] = (await line.until(kind, device, now)).content
            await line.close()
            return sent

    sent = asyncio.run(play())
    answer = predictor.press(pose.translation, rotation=pose.rotation)
    frame = RasFrame.of_mesh(predictor.mesh)
    expected = frame.motion(motion_matrices(predictor.mesh, answer.motions))
    for matrix, device in zip(expected, ("L1", "L2"), strict=True):
        np.testing.assert_allclose(TransformBody.unpack(sent[device]).matrix, matrix, atol=1e-4)
    force = NdarrayBody.unpack(sent["Force"]).array
    np.testing.assert_allclose(force[0, :3], frame.vectors(answer.force), atol=1e-3)
    assert np.linalg.norm(force[0, :3]) > 0.1
    assert json.loads(StringBody.unpack(sent["Trust"]).text)["sound"] == answer.trust.sound
    lengths = np.linalg.norm(answer.displacement[np.unique(predictor.mesh.skin_faces)], axis=1)
    np.testing.assert_allclose(PolyDataBody.unpack(sent["Skin"]).attributes["displacement_mm"], lengths, atol=1e-4)


def test_transforms_have_left_before_anything_else_is_made(predictor):
    came, in_time = threading.Event(), []

    class Waiting(Publisher):
        def messages(self, kind, frame):
            if kind != "TRANSFORM" and frame.timestamp == 7:
                in_time.append(came.wait(20.0))  # the loop stands still meanwhile
            return super().messages(kind, frame)

    def peer(port):
        wanted = Message("TRANSFORM", "L2", bytes(48), 7).pack()[2:42]  # type, device, timestamp
        with socket.create_connection(("127.0.0.1", port)) as line:
            matrix = publisher.frame.probe_from_world(above().rotation, above().translation)
            line.sendall(Message("TRANSFORM", "Probe", TransformBody(matrix).pack(), 7).pack())
            data = b""
            while wanted not in data:
                data += line.recv(65536)
            came.set()

    async def play():
        async with _serving(predictor, publisher=publisher) as port:
            await asyncio.to_thread(peer, port)
            while not in_time:
                await asyncio.sleep(0.01)

    publisher = Waiting(predictor.mesh)
    asyncio.run(play())
    assert in_time[0]


def test_what_is_asked_for_is_sent(predictor):
    quiet = StreamConfig(skin_rate=0.0, grid_rate=0.0)

    async def play():
        async with _serving(predictor, quiet) as port:
            line = await Line.to(port)
            line.send("GET_POLYDATA", "Skin")
            PolyDataBody.unpack((await line.until("POLYDATA")).content)
            line.send("GET_IMAGE")
            image = ImageBody.unpack((await line.until("IMAGE")).content)
            line.send("STT_IMAGE", "x", struct.pack(">Q", 1 << 30))  # every quarter of a second
            assert (await line.until("RTS_IMAGE")).device == "x"
            await line.until("IMAGE")
            line.send("STP_TRANSFOR")
            await line.until("RTS_TRANSFOR")
            line.move(Publisher(predictor.mesh), above(), 5)
            kinds = set()
            while "IMAGE" not in kinds:
                kinds.add((await line.read()).type)
            line.send("GET_STATUS")
            assert StatusBody.unpack((await line.until("STATUS")).content).code == StatusCode.OK
            await line.close()
            return image, kinds

    image, kinds = asyncio.run(play())
    assert image.voxels.shape == (5, 5, 5, 3)
    assert kinds == {"NDARRAY", "STRING", "IMAGE"}


def _hostile():
    good = Message("TRANSFORM", "Probe", TransformBody(np.eye(4)).pack()).pack()
    wrong = bytearray(good)
    wrong[-1] ^= 1
    skewed, broken = np.eye(4), np.eye(4)
    skewed[0, 1], broken[0, 3] = 0.5, np.nan
    yield "wrong checksum", bytes(wrong)
    yield "cut off", good[:70]
    yield "cut off in the header", good[:20]
    yield "no protocol", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n" * 8
    yield "zeros", bytes(500)
    yield "random", np.random.default_rng(3).bytes(4000)
    yield "huge body", Header("TRANSFORM", "Probe", 0, 1 << 62, 0).pack()
    yield "large body that never comes", Header("TRANSFORM", "Probe", 0, 1 << 27, 0).pack() + bytes(1000)
    yield "unknown type", Message("NOSUCHTYPE", "Probe", b"abc").pack()
    yield "unknown question", Message("GET_NOSUCH", "Probe").pack()
    yield "another version", struct.pack(">H", 9) + good[2:]
    yield "empty transform", Message("TRANSFORM", "Probe").pack()
    yield "sheared", Message("TRANSFORM", "Probe", TransformBody(skewed).pack()).pack()
    yield "not a number", Message("TRANSFORM", "Probe", TransformBody(broken).pack()).pack()
    yield "extended header that does not fit", Message("TRANSFORM", "Probe", b"x", version=2).pack()[:60] + bytes(20)
    yield "flood", Message("STRING", "Probe", StringBody("x" * 100).pack()).pack() * 3000
    yield "pose beyond sense", Message("TRANSFORM", "Probe", TransformBody(np.diag([1.0, -1, -1, 1])).pack()).pack()


def test_hostile_peers_disturb_nobody(predictor):
    publisher = Publisher(predictor.mesh)

    async def play():
        async with _serving(predictor) as port:
            good, others = await Line.to(port), []
            for number, (name, data) in enumerate(_hostile(), start=1):
                other = await Line.to(port)
                other.writer.write(data)
                others.append(other)
                await asyncio.sleep(0.01)
                # The good peer's own pose is answered, whatever the other did to the probe meanwhile.
                good.move(publisher, above(depth=1.0 + 0.1 * number), number)
                assert await good.until("TRANSFORM", "L1", number), name
            for line in [good, *others]:
                await line.close()

    asyncio.run(play())


def test_a_damaged_message_is_skipped_and_said(predictor):
    damaged = bytearray(Message("TRANSFORM", "Probe", TransformBody(np.eye(4)).pack()).pack())
    damaged[-1] ^= 1

    async def play():
        async with _serving(predictor) as port:
            line = await Line.to(port)
            await line.until("STATUS")
            line.writer.write(bytes(damaged))
            status = StatusBody.unpack((await line.until("STATUS")).content)
            assert "checksum" in status.text
            line.writer.write(Header("IMAGE", "CT", 0, 3 << 20, 0).pack() + bytes(3 << 20))
            assert "more than" in StatusBody.unpack((await line.until("STATUS")).content).text
            line.move(Publisher(predictor.mesh), above(), 9)
            assert await line.until("TRANSFORM", "L2", 9)
            await line.close()

    asyncio.run(play())


class _Talkative(Publisher):
    """Says 60 kB about every pose, so that the system's own buffers are soon full."""

    def messages(self, kind, frame):
        if kind != "STRING":
            return super().messages(kind, frame)
        return [Message(kind, "Trust", StringBody("x" * 60_000).pack(), frame.timestamp)]


def test_a_peer_that_does_not_read_holds_up_nobody_and_then_gets_the_newest(predictor):
    publisher = _Talkative(predictor.mesh)

    async def play():
        async with _serving(predictor, publisher=publisher) as port:
            slow, quick = await Line.to(port), await Line.to(port)
            slow.writer.transport.pause_reading()
            for number in range(1, 301):
                quick.move(publisher, above(depth=1.0 + number / 200), number)
                await quick.until("TRANSFORM", "L2", number)
            slow.writer.transport.resume_reading()
            seen, latest = 0, 0
            while latest < 300:
                latest = (await slow.until("TRANSFORM", "L2")).timestamp
                seen += 1
            await slow.close()
            await quick.close()
            return seen

    assert asyncio.run(play()) < 150


def test_more_peers_than_allowed_are_turned_away(predictor):
    async def play():
        async with _serving(predictor, StreamConfig(most_peers=2)) as port:
            first, second, third = await Line.to(port), await Line.to(port), await Line.to(port)
            status = StatusBody.unpack((await third.until("STATUS")).content)
            with pytest.raises(asyncio.IncompleteReadError):
                await third.read()
            await first.until("STATUS")
            for line in (first, second, third):
                await line.close()
            return status

    assert asyncio.run(play()).code == StatusCode.BUSY


def _question(predictor, number):
    """A pose, and how the header of L2's answer to it begins: version, type, device, time."""
    frame, pose = RasFrame.of_mesh(predictor.mesh), above(depth=2.0 + 0.1 * number)
    content = TransformBody(frame.probe_from_world(pose.rotation, pose.translation)).pack()
    return Message("TRANSFORM", "Probe", content, number).pack(), Header("TRANSFORM", "L2", number, 0, 0).pack()[:42]


def test_twenty_of_twenty_callers_are_served_after_the_one_before_was_killed(predictor):
    async def play():
        answered = 0
        async with _serving(predictor) as port:
            for number in range(1, 22):  # the first one, and twenty after a kill
                peer = await process("caller", port, *_question(predictor, number))
                async with asyncio.timeout(30.0):
                    answered += (await peer.stdout.readline()) == b"answered\n"
                peer.kill()
                await peer.wait()
        return answered

    assert asyncio.run(play()) == 21


def test_twenty_of_twenty_listeners_are_called_again_after_they_were_killed(predictor):
    async def play():
        answered, port = 0, 0
        session = LiveSession(predictor, friction=Friction.STRAIGHT)
        async with Stream(session, Publisher(predictor.mesh)) as stream:
            calling = None
            for number in range(1, 22):
                peer = await process("listener", port, *_question(predictor, number))
                async with asyncio.timeout(30.0):
                    port = int(await peer.stdout.readline())
                    if calling is None:
                        calling = asyncio.create_task(call(stream, "127.0.0.1", port, tell=lambda line: None))
                    answered += (await peer.stdout.readline()) == b"answered\n"
                peer.kill()
                await peer.wait()
            calling.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await calling
        session.close()
        return answered

    assert asyncio.run(play()) == 21


def test_an_independent_program_understands_it(predictor):
    pyigtl = pytest.importorskip("pyigtl")
    publisher, pose = Publisher(predictor.mesh), above(depth=4.0)
    matrix = publisher.frame.probe_from_world(pose.rotation, pose.translation)

    def talk(port):
        client = pyigtl.OpenIGTLinkClient("127.0.0.1", port)
        try:
            assert client.wait_for_message("L1", timeout=20) is not None
            client.send_message(pyigtl.TransformMessage(matrix, device_name="Probe"), wait=True)
            for _ in range(200):
                moved = client.wait_for_message("L1", timeout=20)
                if not np.allclose(moved.matrix, np.eye(4)):
                    return moved.matrix, client.wait_for_message("Trust", timeout=20)
        finally:
            client.stop()
        raise AssertionError("no answer")

    async def play():
        # This program cannot read POLYDATA, so none is sent to it.
        async with _serving(predictor, StreamConfig(skin_rate=0.0)) as port:
            return await asyncio.to_thread(talk, port)

    moved, trust = asyncio.run(play())
    answer = predictor.press(pose.translation, rotation=pose.rotation)
    expected = publisher.frame.motion(motion_matrices(predictor.mesh, answer.motions))[0]
    np.testing.assert_allclose(moved, expected, atol=1e-3)
    assert "pose" in json.loads(trust.string)


def test_an_address_in_use_is_said(predictor):
    async def play():
        async with _serving(predictor) as port:
            session = LiveSession(predictor)
            async with Stream(session, Publisher(predictor.mesh)) as another:
                with pytest.raises(InputError, match="choose another --port"):
                    await listen(another, "127.0.0.1", port, ready=print)
            session.close()

    asyncio.run(play())


@pytest.mark.parametrize("text", ["", ":18944", "host:", "host:0", "host:99999", "host:abc"])
def test_addresses_are_checked(text):
    with pytest.raises(InputError, match="host:port"):
        address(text)


def test_an_address_has_a_usual_port():
    assert address("slicer") == ("slicer", 18944)
    assert address("10.0.0.5:19000") == ("10.0.0.5", 19000)
