"""LiveClient: poses to a server, answers from it; for scripts, robots and tests. It brings no solver and no bundle."""

import json
import threading
import time
import urllib.error
import urllib.request
from collections import deque
from collections.abc import Sequence
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as connect_websocket
from websockets.typing import Subprotocol

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.server.protocol import SUBPROTOCOL, VERSION, Frame, Kind, decode_answer, decode_surface


class LiveClient:
    """One live client of a server. Poses go out at once; a thread receives.

    Attributes:
        scene: description of the scene.
        newest: the newest live answer, if there is one.

    Example:
        >>> from mixpinn.server.run import LiveServer
        >>> from mixpinn.server.gate import Door
        >>> from mixpinn.serving import load_predictor
        >>> with LiveServer(load_predictor("runs/hybrid"), Door(port=0)) as server, connect(server.url) as client:
        ...     high = client.scene["high"][1]
        ...     frame = client.wait_for(client.touch((0.0, high, 0.0), depth=2.0))
        >>> frame.probes["depth"].round(3).tolist()
        [2.0]
    """

    def __init__(
        self, url: str, *, token: str | None = None, encoding: str = "float32", vertices: str = "nodes",
        friction: str = "remembered", errors: bool = False, timeout: float = 30.0,
    ) -> None:
        """Connect; see `connect`."""
        self._base, self._token, self._timeout = url.rstrip("/"), token, timeout
        self.scene: dict[str, Any] = json.loads(self.fetch("/api/scene.json"))
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        parts = urlsplit(self._base)
        address = f"{'wss' if parts.scheme == 'https' else 'ws'}://{parts.netloc}/live"
        try:
            self._socket: ClientConnection = connect_websocket(
                address, subprotocols=[Subprotocol(SUBPROTOCOL)], additional_headers=headers, compression=None,
                max_size=2**28, open_timeout=timeout, proxy=None,
            )
        except (OSError, InvalidHandshake, TimeoutError) as error:
            raise _unreachable(url, error) from error
        self._changed = threading.Condition()
        self._frames: deque[Frame] = deque(maxlen=64)
        self._messages: deque[dict[str, Any]] = deque(maxlen=256)
        self._closed: str | None = None
        self._number, self.newest = 0, None  # type: int, Frame | None
        self._thread = threading.Thread(target=self._receive, name="mixpinn-client", daemon=True)
        self._thread.start()
        self.say(
            "hello", version=VERSION, encoding=encoding, vertices=vertices, friction=friction, errors=errors,
        )
        self.welcome = self.wait_for_message("welcome")

    def fetch(self, path: str) -> bytes:
        """What the server has at a path.

        Raises:
            InputError: there is no server, it refuses, or it has nothing there.
        """
        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        request = urllib.request.Request(self._base + path, headers=headers)
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        try:
            with opener.open(request, timeout=self._timeout) as answer:
                found: bytes = answer.read()
                return found
        except (urllib.error.URLError, OSError, ValueError) as error:
            raise _unreachable(self._base + path, error) from error

    def surface(self, url: str) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Points (v, 3) [mm], triangles (t, 3) and ids (v,) of a surface that the scene names."""
        return decode_surface(self.fetch(url))

    def say(self, type: str, **values: Any) -> None:
        """Send a control message of the protocol.

        Raises:
            InputError: the connection has ended.
        """
        try:
            self._socket.send(json.dumps({"type": type, **values}))
        except ConnectionClosed as error:
            raise self._ended() from error

    def move(
        self, tip: AnyArray | Sequence[float], *, rotation: AnyArray | None = None, probe: int = 0,
        pose_id: int | None = None,
    ) -> int:
        """Say where a probe is; returns the pose's number at once.

        Args:
            tip: where its tip is, world [mm], shape (3,).
            rotation: rotation matrix, shape (3, 3); by default it presses along −y, unturned.
            probe: index of the probe.
            pose_id: number that the answer is to name; by default the next one.
        """
        number = self._next(pose_id)
        turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=np.float64)
        self.say("pose", id=number, probe=probe, tip=[float(x) for x in tip], rotation=turn.ravel().tolist())
        return number

    def touch(
        self, point: AnyArray | Sequence[float], *, depth: float, axis: str = "pressing", turn_deg: float = 0.0,
        tilt_deg: Sequence[float] = (0.0, 0.0), probe: int = 0, pose_id: int | None = None,
    ) -> int:
        """Put a probe onto the skin; returns the pose's number at once.

        Args:
            point: on the skin [mm], shape (3,).
            depth: beyond first touch [mm].
            axis: ``pressing``: along the direction that was learned from; ``normal``: into the skin.
            turn_deg: about its own axis [degree].
            tilt_deg: about the world's x and z [degree], shape (2,).
            probe: index of the probe.
            pose_id: number that the answer is to name; by default the next one.
        """
        number = self._next(pose_id)
        self.say(
            "skin", id=number, probe=probe, point=[float(x) for x in point], depth=float(depth), axis=axis,
            turn_deg=float(turn_deg), tilt_deg=[float(x) for x in tilt_deg],
        )
        return number

    def press(
        self, tip: AnyArray | Sequence[float], *, rotation: AnyArray | None = None, probe: int = 0,
        timeout: float | None = None,
    ) -> Frame:
        """Move a probe and wait for the answer; arguments of `move`.

        Raises:
            InputError: the pose was refused, no answer came in time, or the connection has ended.
        """
        return self.wait_for(self.move(tip, rotation=rotation, probe=probe), timeout=timeout)

    def wait_for(self, pose_id: int, *, timeout: float | None = None, kind: Kind = Kind.LIVE) -> Frame:
        """The answer to a pose, or to a newer one.

        Raises:
            InputError: the pose was refused, no answer came in time, or the connection has ended.
        """
        def ready() -> bool:
            found = self._found(pose_id, kind) is not None or self._error(pose_id) is not None
            return found or self._closed is not None

        with self._changed:
            if not self._changed.wait_for(ready, timeout or self._timeout):
                raise InputError("pose", expected=f"an answer within {timeout or self._timeout:g} s", got="none",
                                 fix="give it more time")
            frame, error = self._found(pose_id, kind), self._error(pose_id)
            if frame is None and error is not None:
                self._messages.remove(error)
        if frame is not None:
            return frame
        if error is not None:
            raise InputError(error["what"], expected=error["expected"], got=error["got"], fix=error["fix"])
        raise self._ended()

    def wait_for_message(self, *types: str, timeout: float | None = None) -> dict[str, Any]:
        """The next control message of one of some types; others before it are dropped.

        Raises:
            InputError: none came in time, or the connection has ended.
        """
        deadline = time.monotonic() + (timeout or self._timeout)
        with self._changed:
            while True:
                while self._messages:
                    message = self._messages.popleft()
                    if message.get("type") in types:
                        return message
                if self._closed is not None:
                    raise self._ended()
                left = deadline - time.monotonic()
                if left <= 0.0 or not self._changed.wait(left):
                    raise InputError("message", expected=" or ".join(types), got="none in time", fix="wait longer")

    def take_frames(self) -> list[Frame]:
        """The answers that have come since the last call, at most the last 64."""
        with self._changed:
            found = list(self._frames)
            self._frames.clear()
        return found

    def close(self) -> None:
        """End the connection."""
        self._socket.close()
        self._thread.join(10.0)

    def __enter__(self) -> "LiveClient":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _next(self, pose_id: int | None) -> int:
        self._number = self._number + 1 if pose_id is None else pose_id
        return self._number

    def _found(self, pose_id: int, kind: Kind) -> Frame | None:
        return next((
            frame for frame in reversed(self._frames) if frame.kind is kind and frame.pose_id >= pose_id
        ), None)

    def _error(self, pose_id: int) -> dict[str, Any] | None:
        return next((
            message for message in self._messages if message.get("type") == "error" and message.get("id") == pose_id
        ), None)

    def _receive(self) -> None:
        reason = "the server ended it"
        try:
            for data in self._socket:
                found = decode_answer(data) if isinstance(data, bytes) else json.loads(data)
                with self._changed:
                    if isinstance(found, Frame):
                        self._frames.append(found)
                        self.newest = found if found.kind is Kind.LIVE else self.newest
                    else:
                        self._messages.append(found)
                    self._changed.notify_all()
        except ConnectionClosed as error:
            reason = str(error)
        except InputError as error:
            reason = str(error)
        with self._changed:
            self._closed = self._socket.close_reason or reason
            self._changed.notify_all()

    def _ended(self) -> InputError:
        return InputError(
            self._base, expected="a connection", got=self._closed or "none: it has ended", fix="connect again",
        )


def connect(
    url: str = "http://127.0.0.1:8321", *, token: str | None = None, encoding: str = "float32",
    vertices: str = "nodes", friction: str = "remembered", errors: bool = False, timeout: float = 30.0,
) -> LiveClient:
    """Connect to a server that ``mixpinn serve`` runs.

    Args:
        url: address of the server.
        token: that it demands, if it does.
        encoding: of displacements: ``float32``, ``int16`` (a thousandth of a millimetre) or ``none``.
        vertices: ``nodes`` for all nodes of the mesh, ``skin`` for the skin's alone.
        friction: ``remembered`` or ``straight``.
        errors: whether the expected error of each vertex is sent.
        timeout: how long to wait for anything [s].

    Raises:
        InputError: there is no server, it refuses, or it speaks another version.
    """
    return LiveClient(
        url, token=token, encoding=encoding, vertices=vertices, friction=friction, errors=errors, timeout=timeout,
    )


def _unreachable(url: str, error: Exception) -> InputError:
    return InputError(
        url, expected="a server of 'mixpinn serve'", got=str(error) or type(error).__name__,
        fix="start it, or check address and token",
    )
