"""What is still to be sent to one peer: of each device the newest message only."""

import asyncio


class Outbox:
    """Messages in the order in which their devices first waited; a newer one takes the place of an older.

    However slowly a peer reads, no more than one message of each type and device waits for it.
    """

    def __init__(self) -> None:
        self._waiting: dict[tuple[str, str], bytes] = {}
        self._filled = asyncio.Event()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, kind: str, device: str, message: bytes) -> None:
        """Send this message of that type and device, in place of one that still waits."""
        self._waiting[kind, device] = message
        self._filled.set()

    async def take(self) -> bytes:
        """The next message; waits for one."""
        while not self._waiting:
            self._filled.clear()
            await self._filled.wait()
        return self._waiting.pop(next(iter(self._waiting)))
