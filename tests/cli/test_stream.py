"""`mixpinn stream` as a user starts it: says what it sends, answers, and ends when it is told to."""

import re
import select
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest

from benchmarks.stream import drag
from mixpinn.base.errors import InputError
from mixpinn.server.igtl.header import HEADER_SIZE, Header
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.polydata import PolyDataBody
from mixpinn.server.igtl.ras import RasFrame
from mixpinn.server.igtl.run import StreamSettings, stream_bundle
from mixpinn.server.igtl.stream import StreamConfig
from mixpinn.server.igtl.transform import TransformBody
from serving.live.pressed import block_predictor, save_bundle


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return save_bundle(block_predictor(), tmp_path_factory.mktemp("bundle"))


def _read(line):
    def exactly(size):
        data = b""
        while len(data) < size:
            data += line.recv(size - len(data))
        return data

    header = Header.unpack(exactly(HEADER_SIZE))
    return Message.unpack(header, exactly(header.body_size))


def test_it_listens_answers_and_ends(bundle):
    stream = subprocess.Popen(
        [sys.executable, "-m", "mixpinn.cli", "stream", str(bundle), "--port", "0"], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )
    try:
        said = ""
        while not (found := re.search(r"listening at 127.0.0.1:(\d+)", said)):
            assert select.select([stream.stdout], [], [], 500.0)[0], said  # compiling takes its time
            line = stream.stdout.readline()
            assert line, said + stream.stderr.read()
            said += line
        assert "sends TRANSFORM L1, L2" in said
        with socket.create_connection(("127.0.0.1", int(found[1])), timeout=60.0) as peer:
            met = {}
            while not {"ProbeModel", "ProbeStart"} <= met.keys():
                message = _read(peer)
                met[message.device] = message
            start = TransformBody.unpack(met["ProbeStart"].content).matrix
            assert len(PolyDataBody.unpack(met["ProbeModel"].content).points) > 100
            start[:3, 3] += 3.0 * start[:3, :3] @ [0.0, -1.0, 0.0]  # three millimetres along the probe's axis
            peer.sendall(Message("TRANSFORM", "Probe", TransformBody(start).pack(), 42).pack())
            while (message := _read(peer)).timestamp != 42 or message.type != "TRANSFORM":
                pass
            assert not np.allclose(TransformBody.unpack(message.content).matrix, np.eye(4), atol=1e-3)
            stream.send_signal(signal.SIGTERM)
            rest, errors = stream.communicate(timeout=60.0)
    finally:
        stream.kill()
    assert stream.returncode == 128 + signal.SIGTERM
    assert "Traceback" not in rest + errors
    assert "stopped" in errors


def test_the_benchmark_drags_a_probe_over_the_back(bundle):
    contents, names = drag(bundle)
    frame = RasFrame.of_mesh(block_predictor().mesh)
    tips = np.array([frame.probe_to_world(TransformBody.unpack(content).matrix)[1] for content in contents])
    assert names == ("L1", "L2")
    assert len(tips) > 300
    assert (np.linalg.norm(np.diff(tips, axis=0), axis=1) < 3.0).all()


@pytest.mark.parametrize(("settings", "named"), [
    (StreamSettings(port=70000), "--port"), (StreamSettings(version=3), "--protocol"),
    (StreamSettings(rates=StreamConfig(probes=9)), "--probes"),
    (StreamSettings(rates=StreamConfig(skin_rate=-1.0)), "--skin-rate"),
    (StreamSettings(rates=StreamConfig(grid_rate=1000.0)), "--grid-rate"),
])
def test_settings_are_checked_before_anything_is_loaded(tmp_path, settings, named):
    with pytest.raises(InputError, match=named):
        stream_bundle(tmp_path, settings, say=print, warn=print)


def test_beyond_this_machine_and_without_an_image_it_warns(bundle):
    warned, taken = [], socket.create_server(("0.0.0.0", 0))
    try:
        settings = StreamSettings(host="0.0.0.0", port=taken.getsockname()[1])
        with pytest.raises(InputError, match="choose another --port"):
            stream_bundle(bundle, settings, say=lambda line: None, warn=warned.append)
    finally:
        taken.close()
    assert "can move the probe" in warned[0]
    assert "says nothing of where its image was" in warned[1]
    assert not RasFrame.of_mesh(block_predictor().mesh).known
