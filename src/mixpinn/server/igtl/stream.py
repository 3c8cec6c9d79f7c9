"""A live session behind OpenIGTLink: poses come in, what the body does goes out, to any number of peers."""

import asyncio
import itertools
import time
from collections import OrderedDict
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass

from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.server.igtl.damaged import DamagedMessage
from mixpinn.server.igtl.devices import STATUS, probe_devices
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.pace import Pace
from mixpinn.server.igtl.peer import Peer
from mixpinn.server.igtl.publisher import Frame, Publisher
from mixpinn.server.igtl.query import Ask, Query, read_query, reply_type
from mixpinn.server.igtl.status import StatusBody, StatusCode
from mixpinn.server.igtl.timestamp import ticks_of
from mixpinn.server.igtl.transform import TransformBody
from mixpinn.serving.live import LiveAnswer, LiveSession, Refusal

_FASTEST = {"POLYDATA": 1.0 / 60.0, "IMAGE": 0.1}
"""Large messages are not made more often than this, whatever a peer asks for [s]."""
_URGENT = ("TRANSFORM",)
"""Types that are on their way before the others are made: navigation waits for them."""
_REMEMBERED = 1024


@dataclass(frozen=True)
class StreamConfig:
    """What is sent to whom.

    Attributes:
        probes: how many probes peers may move.
        skin_rate: skins a second that are sent without being asked for [1/s]; 0 sends none.
        grid_rate: the same of the grid of displacements.
        most_peers: further ones are turned away.
    """

    probes: int = 1
    skin_rate: float = 10.0
    grid_rate: float = 0.0
    most_peers: int = 32


class Stream:
    """Peers of one session.

    Everything but the predictions happens in one event loop. A peer that does not read holds up nobody: of each device
    only the newest message waits for it.
    """

    def __init__(
        self, session: LiveSession, publisher: Publisher, config: StreamConfig | None = None, *,
        greeting: Sequence[Message] = (), tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        """Prepare.

        Args:
            session: that answers poses.
            publisher: that makes messages of its answers.
            config: what is sent to whom.
            greeting: sent once to every peer that comes, before anything else but the status.
            tell: called with a line of text when a peer comes or goes.
        """
        self._session, self._publisher, self._config = session, publisher, config or StreamConfig()
        self._tell, self._greeting = tell, [(kept.type, kept.device, kept.pack()) for kept in greeting]
        self._probes = {name: index for index, name in enumerate(probe_devices(self._config.probes))}
        self._peers: dict[Peer, dict[str, Pace]] = {}
        self._timers: dict[Peer, asyncio.TimerHandle] = {}
        self._frame = Frame(None)
        self._packed: dict[str, list[tuple[str, bytes]]] = {}
        self._numbers = itertools.count(1)
        self._asked: OrderedDict[int, int] = OrderedDict()
        self._preparing: asyncio.Future[None] | None = None

    async def __aenter__(self) -> "Stream":
        self._loop = asyncio.get_running_loop()
        self._leave = self._session.listen(self._heard)
        return self

    async def __aexit__(self, *exception: object) -> None:
        self._leave()
        for timer in self._timers.values():
            timer.cancel()

    async def welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection until it ends."""
        peer = Peer(reader, writer)
        if len(self._peers) >= self._config.most_peers:
            text = f"{len(self._peers)} peers are connected already"
            writer.write(self._status(StatusCode.BUSY, text).pack())
            await asyncio.sleep(0)
            writer.close()
            self._tell(f"{peer.name} was turned away: {text}")
            return
        self._peers[peer] = self._paces()
        self._tell(f"{peer.name} connected")
        peer.outbox.put("STATUS", STATUS, self._status(StatusCode.OK, "ready").pack())
        for kind, device, kept in self._greeting:
            peer.outbox.put(kind, device, kept)
        self._send_to(peer)
        why = "this program ended"
        try:
            why = await peer.run(self._take, self._refuse)
        finally:
            del self._peers[peer]
            timer = self._timers.pop(peer, None)
            if timer is not None:
                timer.cancel()
            self._tell(f"{peer.name} left: {why}")

    def _paces(self) -> dict[str, Pace]:
        rates = {"POLYDATA": self._config.skin_rate, "IMAGE": self._config.grid_rate}
        paces = {}
        for kind in self._publisher.kinds:
            rate = rates.get(kind)
            slowest = _FASTEST.get(kind, 0.0)
            paces[kind] = Pace(max(slowest, 1.0 / rate) if rate else slowest, streaming=rate is None or rate > 0.0)
        return paces

    def _take(self, peer: Peer, message: Message) -> None:
        """Whatever is neither a probe's pose nor a question is left alone."""
        if message.type == "TRANSFORM" and message.device in self._probes:
            try:
                rotation, tip = self._publisher.frame.probe_to_world(TransformBody.unpack(message.content).matrix)
            except DamagedMessage as damage:
                self._refuse(peer, damage)
                return
            number = next(self._numbers)
            self._asked[number] = message.timestamp or ticks_of(time.time())
            while len(self._asked) > _REMEMBERED:
                self._asked.popitem(last=False)
            self._session.move(ProbePose(rotation, tip), probe=self._probes[message.device], pose_id=number)
        elif message.type == "GET_STATUS":
            peer.outbox.put("STATUS", STATUS, self._status(StatusCode.OK, "ready").pack())
        else:
            query = read_query(message, self._publisher.kinds)
            if query is not None:
                self._ask(peer, message, query)

    def _ask(self, peer: Peer, message: Message, query: Query) -> None:
        pace = self._peers[peer][query.kind]
        if query.ask is Ask.ONCE:
            pace.asked = True
        else:
            pace.streaming = query.ask is Ask.BEGIN
            pace.stale = True
            if query.interval is not None:
                pace.interval = max(query.interval, _FASTEST.get(query.kind, 0.0))
            kind = reply_type(query.kind)
            peer.outbox.put(kind, message.device, Message(kind, message.device, b"\0").pack())
        self._send_to(peer)

    def _refuse(self, peer: Peer, damage: DamagedMessage) -> None:
        peer.outbox.put("STATUS", STATUS, self._status(StatusCode.ILLEGAL_INSTRUCTION, str(damage)).pack())

    def _status(self, code: StatusCode, text: str, timestamp: int = 0) -> Message:
        name = "" if code is StatusCode.OK else code.name
        return Message("STATUS", STATUS, StatusBody(code, 0, name, text).pack(), timestamp or ticks_of(time.time()))

    def _heard(self, found: LiveAnswer | Refusal) -> None:
        """Called from the session's thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._answered, found)

    def _answered(self, found: LiveAnswer | Refusal) -> None:
        timestamp = self._asked.get(found.pose_id, 0)
        if isinstance(found, Refusal):
            status = self._status(StatusCode.CONFIG_ERROR, str(found.error), timestamp).pack()
            for peer in self._peers:
                peer.outbox.put("STATUS", STATUS, status)
            return
        self._frame, self._packed = Frame(found.answer, timestamp, found.pose_id), {}
        for peer, paces in self._peers.items():
            for pace in paces.values():
                pace.stale = True
            self._send_to(peer, _URGENT)
        self._loop.call_soon(self._send_rest)  # whoever sends was woken before

    def _send_rest(self) -> None:
        for peer in self._peers:
            self._send_to(peer)

    def _send_to(self, peer: Peer, kinds: Container[str] | None = None) -> None:
        """Put what a peer wants and what is due into its outbox, and come back for the rest; `kinds` or all."""
        paces = self._peers.get(peer)
        if paces is None:
            return
        now, later = self._loop.time(), []
        for kind, pace in paces.items():
            if not pace.wanted() or (kinds is not None and kind not in kinds):
                continue
            if now < pace.due:
                later.append(pace.due)
            elif kind != "IMAGE" or self._grid_is_ready():
                for device, message in self._messages(kind):
                    peer.outbox.put(kind, device, message)
                pace.sent(now)
        if later and peer not in self._timers:
            self._timers[peer] = self._loop.call_at(min(later), self._come_back, peer)

    def _come_back(self, peer: Peer) -> None:
        self._timers.pop(peer, None)
        self._send_to(peer)

    def _messages(self, kind: str) -> list[tuple[str, bytes]]:
        """Of the newest answer; made once, for whichever peers want them."""
        if kind not in self._packed:
            made = self._publisher.messages(kind, self._frame)
            self._packed[kind] = [(message.device, message.pack()) for message in made]
        return self._packed[kind]

    def _grid_is_ready(self) -> bool:
        """Whether the grid is there; finding its voxels begins beside the loop where it is not."""
        if self._publisher.grid_ready:
            return True
        if self._preparing is None:
            self._preparing = self._loop.run_in_executor(None, self._publisher.prepare_grid)
            self._preparing.add_done_callback(self._grid_came)
        return False

    def _grid_came(self, done: "asyncio.Future[None]") -> None:
        for peer in self._peers:
            self._send_to(peer)
