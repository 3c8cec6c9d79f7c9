"""One connection: what comes is read message by message, what is to go waits in an outbox."""

import asyncio
import socket
from collections.abc import Callable

from mixpinn.server.igtl.damaged import DamagedMessage, UnusablePeer
from mixpinn.server.igtl.header import HEADER_SIZE, Header
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.outbox import Outbox

LARGEST_BODY = 1 << 20
"""Bodies that are read; what a probe and its questions need is far smaller [byte]."""
LARGEST_SKIPPED = 1 << 28
"""Bodies that are skipped; a larger one is taken for a damaged header [byte]."""
_CHUNK = 1 << 16


class Peer:
    """A connected program.

    Attributes:
        name: its address.
        outbox: what waits to be sent to it.
        skipped: messages that came damaged or too large.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        address = writer.get_extra_info("peername")
        self.name = ":".join(map(str, address[:2])) if isinstance(address, tuple) else str(address)
        self.outbox = Outbox()
        self.skipped = 0
        # Little is handed to the system ahead of time, so that newer messages can still take the place of older ones.
        writer.transport.set_write_buffer_limits(high=_CHUNK)
        connection = writer.get_extra_info("socket")
        if isinstance(connection, socket.socket):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 * _CHUNK)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    async def run(
        self, take: Callable[["Peer", Message], None], refuse: Callable[["Peer", DamagedMessage], None],
    ) -> str:
        """Read and send until the connection ends.

        Args:
            take: called with every sound message.
            refuse: called with every one that was skipped.

        Returns:
            Why it ended.
        """
        sending = asyncio.create_task(self._send())
        try:
            while True:
                try:
                    take(self, await self._read())
                except DamagedMessage as damage:
                    self.skipped += 1
                    refuse(self, damage)
                await asyncio.sleep(0)  # others have their turn, however much this peer sends
        except asyncio.IncompleteReadError:
            return "closed by the peer"
        except (OSError, UnusablePeer) as error:
            return str(error) or type(error).__name__
        finally:
            sending.cancel()
            self._writer.transport.abort()  # without waiting for what is not read
            await asyncio.wait({sending})  # raises nothing of the task's own, but lets this one be cancelled
            if not sending.cancelled():
                sending.exception()  # seen: reading ends for the same reason

    async def _read(self) -> Message:
        header = Header.unpack(await self._reader.readexactly(HEADER_SIZE))
        if header.body_size > LARGEST_SKIPPED:
            raise UnusablePeer(f"a body of {header.body_size} bytes is announced, more than {LARGEST_SKIPPED}")
        if header.body_size > LARGEST_BODY:
            left = header.body_size
            while left:
                left -= len(await self._reader.readexactly(min(left, _CHUNK)))
            raise DamagedMessage(f"{header.type}: a body of {header.body_size} bytes is more than {LARGEST_BODY}")
        return Message.unpack(header, await self._reader.readexactly(header.body_size))

    async def _send(self) -> None:
        while True:
            self._writer.write(await self.outbox.take())
            await self._writer.drain()
