"""Forty malformed or hostile messages and requests: each gets the right refusal, and nobody else notices."""

import contextlib
import json
import logging
import socket
import time

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect as connect_raw

from mixpinn.base.errors import InputError
from mixpinn.server.client import connect
from mixpinn.server.gate import Door
from mixpinn.server.run import LiveServer
from server.conftest import LIMITS
from serving.live.pressed import above

POSE = {"type": "pose", "id": 1, "tip": [18.0, 39.0, 22.0], "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1]}
HELLO = json.dumps({"type": "hello", "version": 1})


@pytest.fixture(scope="module")
def bystander(server):
    """A client of good will that is there all the time."""
    with connect(server.url) as client:
        yield client


@pytest.fixture(autouse=True)
def nobody_else_notices(bystander, predictor, caplog):
    caplog.set_level(logging.WARNING)
    yield
    pose = above(depth=2.5)
    began = time.perf_counter()
    frame = bystander.press(pose.translation)
    assert time.perf_counter() - began < 5.0
    bystander.say("forget")
    assert_array_equal(bystander.press(pose.translation).probes["index"], [0])
    assert frame.displacement.any()
    assert not [record for record in caplog.records if record.exc_info or "Traceback" in record.getMessage()]


@contextlib.contextmanager
def greeted(server):
    with connect_raw(_address(server), subprotocols=["mixpinn.live.1"], compression=None) as raw:
        raw.send(HELLO)
        assert json.loads(raw.recv(5.0))["type"] == "welcome"
        yield raw


def _address(server) -> str:
    return server.url.replace("http", "ws") + "live"


def changed(**fields):
    return json.dumps({**POSE, **fields})


MESSAGES = {
    "no JSON": "press please",
    "cut JSON": json.dumps(POSE)[:40],
    "empty": "",
    "a list": "[1, 2, 3]",
    "a number": "7",
    "null": "null",
    "no type": json.dumps({"id": 1}),
    "type of another kind": json.dumps({"type": ["pose"], "id": 1}),
    "unknown type": json.dumps({"type": "shutdown"}),
    "deeply nested": "[" * 20_000 + "]" * 20_000,
    "tip with NaN": '{"type": "pose", "id": 1, "tip": [NaN, 0, 0], "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1]}',
    "tip with infinity": '{"type": "pose", "id": 1, "tip": [1e999, 0, 0], "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1]}',
    "tip of texts": changed(tip=["1", "2", "3"]),
    "tip of two": changed(tip=[1.0, 2.0]),
    "tip as text": changed(tip="123"),
    "tip beyond measure": changed(tip=[1e300, 0.0, 0.0]),
    "tip of booleans": changed(tip=[True, False, True]),
    "rotation of eight": changed(rotation=[1.0] * 8),
    "huge whole number": changed(tip=[10**400, 0, 0]),
    "quaternion of zeros": json.dumps({"type": "pose", "id": 1, "tip": [0, 0, 0], "quaternion": [0, 0, 0, 0]}),
    "negative id": changed(id=-1),
    "id with a fraction": changed(id=1.5),
    "id beyond 32 bits": changed(id=2**32),
    "probe that cannot be": changed(probe=99),
    "depth as text": json.dumps({"type": "skin", "id": 1, "point": [18, 40, 22], "depth": "deep"}),
    "unknown axis": json.dumps({"type": "skin", "id": 1, "point": [18, 40, 22], "depth": 1, "axis": "up"}),
    "format that is a path": json.dumps({"type": "save", "format": "../../etc/passwd"}),
    "speed of zero": json.dumps({"type": "replay", "speed": 0}),
    "record without on": json.dumps({"type": "record"}),
    "choice that is none": json.dumps({"type": "set", "encoding": "pickle"}),
    "binary": b"\x00\x01\x02\xff",
}
"""Messages that cannot be read."""
REFUSED = {
    "rotation that mirrors": (changed(rotation=[-1, 0, 0, 0, 1, 0, 0, 0, 1]), "bad-pose"),
    "rotation that stretches": (changed(rotation=[2, 0, 0, 0, 1, 0, 0, 0, 1]), "bad-pose"),
    "upside down": (changed(rotation=[1, 0, 0, 0, -1, 0, 0, 0, -1]), "refused"),
    "deep inside": (changed(tip=[18.0, -80.0, 22.0]), "refused"),
    "skin that is elsewhere": (
        json.dumps({"type": "skin", "id": 1, "point": [9e4, 0, 0], "depth": 1}), "refused"),
    "replay of nothing": (json.dumps({"type": "replay"}), "refused"),
    "hello again": (HELLO, "refused"),
}
"""Messages that can be read and make no sense."""


@pytest.mark.parametrize("name", MESSAGES)
def test_what_cannot_be_read_is_refused_and_the_connection_goes_on(server, name) -> None:
    with greeted(server) as raw:
        raw.send(MESSAGES[name])
        said = json.loads(raw.recv(5.0))
        assert (said["type"], said["code"]) == ("error", "bad-message")
        assert len(said["text"]) < 400
        raw.send(json.dumps(POSE))
        assert isinstance(raw.recv(10.0), bytes)


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_sense_is_refused_with_its_reason(server, name) -> None:
    text, code = REFUSED[name]
    with greeted(server) as raw:
        raw.send(text)
        said = json.loads(raw.recv(10.0))
        assert (said["type"], said["code"]) == ("error", code)
        raw.send(json.dumps(POSE))
        assert isinstance(raw.recv(10.0), bytes)


def test_who_goes_on_with_nonsense_is_sent_away(server) -> None:
    with greeted(server) as raw:
        for _ in range(LIMITS.bad_messages):
            raw.send("nonsense")
        _read_to_the_end(raw)
        assert raw.close_code == 1008


@pytest.mark.parametrize("size", [70_000, 3_000_000])
def test_huge_messages_end_the_connection(server, size) -> None:
    with greeted(server) as raw:
        with contextlib.suppress(ConnectionClosed):
            raw.send(json.dumps({"type": "ping", "id": 1, "fill": "x" * size}))
        _read_to_the_end(raw)
        assert raw.close_code in (1006, 1009)


def test_a_message_that_claims_to_be_huge_and_is_cut(server) -> None:
    with greeted(server) as raw:
        raw.socket.sendall(bytes([0x81, 0xFF]) + (2**62).to_bytes(8, "big") + b"\0\0\0\0" + b"xx")
        with pytest.raises(ConnectionClosed):
            raw.recv(5.0)


def test_a_flood_is_cut_off(server) -> None:
    with greeted(server) as raw:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(200_000):
                raw.send('{"type": "forget"}')
        _read_to_the_end(raw)
        assert raw.close_code in (1006, 1008)


def test_another_first_word_and_silence_are_sent_away(server) -> None:
    for first in (json.dumps(POSE), "hello", json.dumps({"type": "hello", "version": 2})):
        with connect_raw(_address(server), subprotocols=["mixpinn.live.1"]) as raw:
            raw.send(first)
            assert json.loads(raw.recv(5.0))["type"] == "error"
            with pytest.raises(ConnectionClosed):
                raw.recv(5.0)
    with connect_raw(_address(server), subprotocols=["mixpinn.live.1"]) as raw:
        _read_to_the_end(raw)
        assert raw.close_code == 1008


def test_another_subprotocol_is_not_accepted(server) -> None:
    with pytest.raises(InvalidStatus):
        connect_raw(_address(server), subprotocols=["chat"])


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "file://"])
def test_pages_of_other_origins_are_refused(server, origin) -> None:
    with pytest.raises(InvalidStatus) as refused:
        connect_raw(_address(server), subprotocols=["mixpinn.live.1"], origin=origin)
    assert refused.value.response.status_code == 403
    assert _ask(server, "/api/scene.json", {"Origin": origin})[0] == 403
    assert _ask(server, "/api/scene.json", {"Origin": server.url.rstrip("/")})[0] == 200


@pytest.mark.parametrize("host", [
    "evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "a@127.0.0.1", "[::",
])
def test_other_names_of_the_host_are_refused(server, host) -> None:
    assert _ask(server, "/api/scene.json", {"Host": host})[0] == 400


@pytest.mark.parametrize("path", [
    "/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/api/../../../etc/passwd", "/..%2f..%2fetc%2fpasswd",
    "/download/../../etc/passwd", "/download/x/%2e%2e%2fpasswd", "/page/..\\..\\secret", "/api/parts/999.bin",
    "//etc/passwd", "/api/scene.json/..", "/\x00", "/%00", "/" + "a" * 8_000,
])
def test_paths_lead_nowhere_else(server, path) -> None:
    status, body = _ask(server, path, {})
    assert status in (400, 404)
    assert b"root:" not in body


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "TRACE", "OPTIONS"])
def test_other_methods_are_refused(server, method) -> None:
    assert _ask(server, "/api/scene.json", {}, method=method)[0] == 405


@pytest.mark.parametrize("data", [
    b"GET / HTTP/1.1\r\nHost: " + b"x" * 40_000, b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"GET /\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil.example\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -5\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n",
])
def test_what_is_no_request_is_answered_with_400_or_closed(server, data) -> None:
    with socket.create_connection(("127.0.0.1", server.door.port), 5.0) as raw:
        with contextlib.suppress(OSError):
            raw.sendall(data)
        found = _until_closed(raw)
    assert found == b"" or found.split(b" ")[1] == b"400"


def test_two_hundred_idle_connections_hold_up_nobody_and_are_closed(server, bystander) -> None:
    idle = [socket.create_connection(("127.0.0.1", server.door.port), 5.0) for _ in range(200)]
    half = [one for k, one in enumerate(idle) if k % 2]
    for one in half:
        one.sendall(b"GET / HTTP/1.1\r\nHo")
    delays = []
    for k in range(20):
        began = time.perf_counter()
        bystander.press(above(x=15.0 + 0.1 * k, depth=2.0).translation)
        delays.append(time.perf_counter() - began)
    assert np.median(delays) < 0.5
    with connect(server.url) as another:
        another.press(above().translation)
    time.sleep(LIMITS.request_s + 0.5)
    assert all(_until_closed(one) == b"" for one in idle)
    for one in idle:
        one.close()


def test_too_many_clients_are_told_so_and_the_silent_make_room(server, bystander) -> None:
    with contextlib.ExitStack() as stack:
        room = LIMITS.clients - server.service.clients
        for _ in range(room):
            stack.enter_context(greeted(server))
        with connect_raw(_address(server), subprotocols=["mixpinn.live.1"]) as raw:
            with pytest.raises(ConnectionClosed) as ended:
                raw.recv(5.0)
            assert ended.value.rcvd.code == 1013
        time.sleep(LIMITS.may_leave_s + 0.1)
        bystander.press(above().translation)
        with greeted(server) as raw:
            raw.send(json.dumps(POSE))
            assert isinstance(raw.recv(10.0), bytes)


def test_beyond_this_machine_a_token_is_demanded(predictor) -> None:
    with pytest.raises(InputError, match="give --token"):
        Door("0.0.0.0", 0)
    with pytest.raises(InputError, match="at least 16"):
        Door("0.0.0.0", 0, "secret")
    token = "0123456789abcdef0123"
    with LiveServer(predictor, Door("127.0.0.1", 0, token), limits=LIMITS) as guarded:
        with pytest.raises(InputError, match="401"):
            connect(guarded.url)
        with pytest.raises(InputError, match="401"):
            connect(guarded.url, token=token[:-1] + "4")
        with connect(guarded.url, token=token) as client:
            client.press(above().translation)
        with pytest.raises(InvalidStatus) as refused:
            connect_raw(_address(guarded), subprotocols=["mixpinn.live.1"])
        assert refused.value.response.status_code == 401
        assert _ask(guarded, "/", {})[0] == 200  # the page itself says nothing of a patient
        assert _ask(guarded, f"/api/scene.json?token={token}", {})[0] == 200


def test_an_address_that_is_taken_is_said_in_a_sentence(server, predictor) -> None:
    with pytest.raises(InputError, match="address that is free"):
        LiveServer(predictor, Door(port=server.door.port))


def _ask(server, path, headers, method="GET"):
    """Status and body of a request that is written as it is, whatever a client library would think of it."""
    fields = {"Host": f"127.0.0.1:{server.door.port}", "Connection": "close", **headers}
    head = f"{method} {path} HTTP/1.1\r\n" + "".join(f"{name}: {value}\r\n" for name, value in fields.items()) + "\r\n"
    with socket.create_connection(("127.0.0.1", server.door.port), 5.0) as raw:
        raw.sendall(head.encode("latin-1"))
        found = _until_closed(raw)
    head, _, body = found.partition(b"\r\n\r\n")
    return int(head.split(b" ")[1]), body


def _read_to_the_end(raw) -> None:
    with contextlib.suppress(ConnectionClosed):
        while True:
            raw.recv(10.0)


def _until_closed(raw: socket.socket) -> bytes:
    raw.settimeout(10.0)
    found = b""
    with contextlib.suppress(ConnectionError):
        while part := raw.recv(65_536):
            found += part
    return found
