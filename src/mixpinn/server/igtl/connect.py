"""How peers are reached: as a server that listens, or as a client that calls and calls again."""

import asyncio
import contextlib
from collections.abc import Callable

from mixpinn.base.errors import InputError
from mixpinn.server.igtl.stream import Stream

PORT = 18944
"""The protocol's usual port."""
LOCAL = "127.0.0.1"
_PATIENCE = 5.0
_FIRST_PAUSE, _LONGEST_PAUSE = 0.1, 2.0
"""Between two calls of a peer that does not answer [s]."""


async def listen(stream: Stream, host: str, port: int, *, ready: Callable[[int], None]) -> None:
    """Take connections until cancelled.

    Args:
        stream: that serves them.
        host: address to listen at.
        port: 0 takes a free one.
        ready: called with the port when connections can come.

    Raises:
        InputError: the address cannot be used.
    """
    async def welcome(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(asyncio.CancelledError):  # the program ends: nobody waits for this task
            await stream.welcome(reader, writer)

    try:
        server = await asyncio.start_server(welcome, host, port)
    except OSError as error:
        raise InputError(
            f"{host}:{port}", expected="an address that is free", got=error.strerror or str(error),
            fix="end the other program, or choose another --port",
        ) from error
    async with server:
        ready(server.sockets[0].getsockname()[1])
        await server.serve_forever()


async def call(stream: Stream, host: str, port: int, *, tell: Callable[[str], None]) -> None:
    """Connect to a peer that listens, and again whenever the connection ends, until cancelled.

    Args:
        stream: that serves the connection.
        host, port: of the peer.
        tell: called with a line of text the first time that the peer does not answer.
    """
    pause, told = _FIRST_PAUSE, False
    while True:
        try:
            async with asyncio.timeout(_PATIENCE):
                reader, writer = await asyncio.open_connection(host, port)
        except OSError as error:  # a time-out is one too
            if not told:
                tell(f"{host}:{port} does not answer ({error.strerror or 'no answer'}); trying again")
                told = True
            await asyncio.sleep(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE)
            continue
        pause, told = _FIRST_PAUSE, False
        with contextlib.suppress(OSError):
            await stream.welcome(reader, writer)
        await asyncio.sleep(pause)


def address(text: str) -> tuple[str, int]:
    """Host and port of ``host:port``, or of a host alone with the usual port.

    Raises:
        InputError: no such address.
    """
    host, _, port = text.rpartition(":") if ":" in text else (text, "", str(PORT))
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise InputError("--connect", expected="host:port", got=repr(text), fix="for example 192.168.0.5:18944")
    return host.strip("[]"), int(port)
