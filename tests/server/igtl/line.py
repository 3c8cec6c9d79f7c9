"""A peer of a stream, for tests: in the loop, or as a process of its own with nothing but sockets."""

import asyncio
import contextlib
import sys

from mixpinn.server.igtl.header import HEADER_SIZE, Header
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.transform import TransformBody

_LISTENER = """
import socket, sys
at = socket.create_server(("127.0.0.1", int(sys.argv[1])))
print(at.getsockname()[1], flush=True)
line = at.accept()[0]
"""
_CALLER = """
import socket, sys
line = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
"""
_TALK = """
import time
line.sendall(bytes.fromhex(sys.argv[2]))
data, wanted = b"", bytes.fromhex(sys.argv[3])
while wanted not in data:
    piece = line.recv(65536)
    if not piece:
        sys.exit("the line ended")
    data = data[-64:] + piece
print("answered", flush=True)
time.sleep(600)
"""


class Line:
    """A connection to a stream."""

    def __init__(self, reader, writer):
        self.reader, self.writer = reader, writer

    @staticmethod
    async def to(port):
        return Line(*await asyncio.open_connection("127.0.0.1", port))

    def send(self, kind, device="", content=b"", timestamp=0):
        self.writer.write(Message(kind, device, content, timestamp).pack())

    def move(self, publisher, pose, timestamp=0, device="Probe"):
        matrix = publisher.frame.probe_from_world(pose.rotation, pose.translation)
        self.send("TRANSFORM", device, TransformBody(matrix).pack(), timestamp)

    async def read(self):
        header = Header.unpack(await self.reader.readexactly(HEADER_SIZE))
        return Message.unpack(header, await self.reader.readexactly(header.body_size))

    async def until(self, kind, device=None, timestamp=None):
        """The next message like this."""
        async with asyncio.timeout(30.0):
            while True:
                message = await self.read()
                if message.type == kind and device in (None, message.device) and timestamp in (None, message.timestamp):
                    return message

    async def close(self):
        self.writer.close()
        with contextlib.suppress(OSError):
            await self.writer.wait_closed()


async def process(kind, port, question, answer):
    """A process that connects (``caller``) or listens (``listener``), sends `question` and waits for `answer`."""
    code = {"caller": _CALLER, "listener": _LISTENER}[kind] + _TALK
    return await asyncio.create_subprocess_exec(
        sys.executable, "-S", "-E", "-c", code, str(port), question.hex(), answer.hex(), stdout=asyncio.subprocess.PIPE,
    )
