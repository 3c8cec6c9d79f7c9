"""ClientLink: one live client. Reads what it says, and sends it the newest answer that it has not got yet."""

import asyncio
import contextlib
import json
import time
from collections import deque
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from mixpinn.base.errors import InputError
from mixpinn.server.limits import ABORT, Bucket
from mixpinn.server.messages import Choices, Message, OnSkin, Order, Pose, message_number, read_choices, read_message
from mixpinn.server.orders import ClientOrders
from mixpinn.server.protocol import (
    SUBPROTOCOL,
    VERSION,
    ErrorCode,
    Kind,
    Vertices,
    encode_answer,
    error_message,
)
from mixpinn.server.service import Service
from mixpinn.serving.live.error_field import error_field
from mixpinn.serving.live.records import LiveAnswer, Refusal
from mixpinn.serving.live.session import LiveSession

_MOST_WAITING = 256
"""Control messages that may wait for a client."""
_MOST_BESIDE = 8
"""Answers of a replay that may wait for a client; the oldest make room."""
_POLICY, _TRY_LATER, _GOING_AWAY = 1008, 1013, 1001


class ClientLink:
    """One live client and its session.

    Attributes:
        heard: when it last said something, by `time.monotonic`.
        session: its body and probes; there after its first message.
        choices: what it wants to be sent.
    """

    def __init__(self, websocket: WebSocket, service: Service) -> None:
        """Take over a connection that was not accepted yet."""
        self.heard, self.choices = time.monotonic(), Choices()
        self.session: LiveSession | None = None
        self._socket, self._service = websocket, service
        self._control: deque[dict[str, Any] | tuple[LiveAnswer, Kind]] = deque()
        self._live: LiveAnswer | None = None
        self._wake = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._closing: tuple[int, str] | None = None
        self._orders: ClientOrders | None = None

    async def run(self) -> None:
        """Serve the client until it goes."""
        limits = self._service.limits
        if SUBPROTOCOL not in self._socket.scope.get("subprotocols", []):
            await self._socket.close(_POLICY, f"speak {SUBPROTOCOL}")
            return
        if not self._service.admit(self):
            await self._socket.accept(SUBPROTOCOL)
            await self._socket.close(_TRY_LATER, "too many clients")
            return
        sender: asyncio.Task[None] | None = None
        try:
            await self._socket.accept(SUBPROTOCOL)
            async with asyncio.timeout(limits.hello_s):
                if not await self._greet():
                    return
            sender = asyncio.create_task(self._send_on())
            reader = asyncio.create_task(self._read_on())
            await asyncio.wait({sender, reader}, return_when=asyncio.FIRST_COMPLETED)
            for task in (sender, reader):
                task.cancel()
            await asyncio.gather(sender, reader, return_exceptions=True)
            if self._closing is not None:
                await self._close(*self._closing)
        except TimeoutError:
            await self._close(_POLICY, f"say hello within {limits.hello_s:g} s")
        except (WebSocketDisconnect, RuntimeError, OSError):
            pass  # it has gone
        finally:
            self._service.dismiss(self)
            if self._orders is not None:
                self._orders.close()
            if self.session is not None:
                self.session.close()

    def leave(self) -> None:
        """Make room for another client."""
        self._end(_GOING_AWAY, "another client needed the room")

    def tell(self, message: dict[str, Any]) -> None:
        """Send a control message; may be called from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._queue, message)

    def show(self, found: LiveAnswer, kind: Kind) -> None:
        """Send an answer beside the live ones; may be called from any thread."""
        def put() -> None:
            waiting = [entry for entry in self._control if isinstance(entry, tuple) and entry[1] is kind]
            if len(waiting) >= _MOST_BESIDE:
                self._control.remove(waiting[0])
            self._control.append((found, kind))
            self._wake.set()

        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(put)

    async def _greet(self) -> bool:
        """The first message; false where it was another one."""
        text = await self._receive()
        try:
            message = read_message(text if isinstance(text, str) else "")
            if not isinstance(message, Order) or message.type != "hello":
                raise InputError(
                    "first message", expected="hello", got=type(message).__name__, fix="say hello first",
                )
        except InputError as error:
            await self._socket.send_text(json.dumps(error_message(error, ErrorCode.BAD_MESSAGE)))
            await self._close(_POLICY, "say hello first")
            return False
        self.choices = message.values["choices"]
        self.session = LiveSession(
            self._service.predictor, worker=self._service.worker, friction=self.choices.friction,
        )
        self._orders = ClientOrders(self, self.session, self._service)
        self.session.listen(self._hear)
        await self._socket.send_text(json.dumps({
            "type": "welcome", "version": VERSION, "session": self._service.sessions, "scene": "/api/scene.json",
            **self.choices.as_dict(),
        }))
        return True

    def _hear(self, found: LiveAnswer | Refusal) -> None:
        """Called by the worker: only the newest answer waits for the client."""
        if isinstance(found, Refusal):
            self.tell(error_message(found.error, ErrorCode.REFUSED, found.pose_id))
            return
        self._live = found
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._wake.set)

    def _queue(self, message: dict[str, Any]) -> None:
        if len(self._control) >= _MOST_WAITING:
            self._end(_POLICY, "control messages are not taken")
            return
        self._control.append(message)
        self._wake.set()

    def _end(self, code: int, reason: str) -> None:
        self._closing = self._closing or (code, reason)
        self._wake.set()

    async def _close(self, code: int, reason: str) -> None:
        with contextlib.suppress(Exception):
            async with asyncio.timeout(2.0):
                await self._socket.close(code, reason)

    async def _receive(self) -> str | bytes:
        message = await self._socket.receive()
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code") or 1005)
        self.heard = time.monotonic()
        text = message.get("text")
        return text if text is not None else message.get("bytes") or b""

    async def _read_on(self) -> None:
        limits, bad = self._service.limits, 0
        bucket = Bucket(limits.rate, limits.burst, time.monotonic())
        while self._closing is None:
            text = await self._receive()
            if not bucket.take(time.monotonic()):
                self._queue(error_message(InputError(
                    "rate", expected=f"at most {limits.rate:g} messages a second", got="more", fix="send fewer poses",
                ), ErrorCode.TOO_FAST))
                self._end(_POLICY, "too many messages")
                return
            try:
                if not isinstance(text, str):
                    raise InputError("message", expected="text", got="binary", fix="send JSON in text frames")
                message = read_message(text)
            except InputError as error:
                self._queue(error_message(error, ErrorCode.BAD_MESSAGE, message_number(text)))
                bad += 1
                if bad >= limits.bad_messages:
                    self._end(_POLICY, "too many messages that cannot be read")
                    return
                continue
            self._obey(message)
            await asyncio.sleep(0)  # others have their turn, however fast this one speaks

    def _obey(self, message: Message) -> None:
        assert self.session is not None
        assert self._orders is not None
        number = getattr(message, "id", None)
        try:
            if isinstance(message, Pose):
                self.session.move(message.pose, probe=message.probe, pose_id=message.id)
            elif isinstance(message, OnSkin):
                pose = self.session.skin.place(
                    message.point, depth=message.depth, axis=message.axis, turn_deg=message.turn_deg,
                    tilt_deg=message.tilt_deg,
                )
                self.session.move(pose, probe=message.probe, pose_id=message.id)
            elif message.type == "set":
                self.choices = read_choices(message.values, self.choices)
                self.session.friction = self.choices.friction
            else:
                self._orders.obey(message)
        except InputError as error:
            bad = error.what in ("poses", "pose", "place on the skin") and "finite" in error.expected
            bad = bad or "rotation matrices" in error.expected
            code = ErrorCode.BAD_POSE if bad else ErrorCode.REFUSED
            self._queue(error_message(error, code, number))

    async def _send_on(self) -> None:
        limits = self._service.limits
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._control:
                entry = self._control.popleft()
                if isinstance(entry, tuple):
                    await self._in_time(self._socket.send_bytes(self._frame(*entry)), limits.send_s)
                else:
                    await self._in_time(self._socket.send_text(json.dumps(entry)), limits.send_s)
            found, self._live = self._live, None
            if found is not None:
                await self._in_time(self._socket.send_bytes(self._frame(found, Kind.LIVE)), limits.send_s)
            if self._closing is not None:
                return

    def _frame(self, found: LiveAnswer, kind: Kind) -> bytes:
        nodes = self._service.scene.skin_nodes if self.choices.vertices is Vertices.SKIN else None
        errors = error_field(found.answer) if self.choices.errors else None
        return encode_answer(
            found, encoding=self.choices.encoding, vertices=nodes, kind=kind, now=time.perf_counter(), errors=errors,
        )

    async def _in_time(self, sending: Any, seconds: float) -> None:
        try:
            async with asyncio.timeout(seconds):
                await sending
        except TimeoutError:
            self._end(_POLICY, "frames are not taken")
            abort = self._socket.scope.get("extensions", {}).get(ABORT)
            if abort is not None:
                abort()
            raise WebSocketDisconnect(1006) from None
