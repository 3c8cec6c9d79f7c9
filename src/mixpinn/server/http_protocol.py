"""uvicorn's protocols with limits: how long a connection may say nothing, and how many connections there may be."""

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from mixpinn.server.limits import ABORT, Limits


class AbortableProtocol(WebSocketsSansIOProtocol):
    """WebSocket whose application can end the connection at once, although the client takes nothing."""

    def handle_connect(self, event: Any) -> None:
        super().handle_connect(event)
        if hasattr(self, "scope"):
            extensions: dict[str, Any] = self.scope["extensions"]
            extensions[ABORT] = self.transport.abort


def guarded_protocol(limits: Limits) -> type[asyncio.Protocol]:
    """A class of protocols that closes connections whose request does not come, and those beyond the limit."""

    class GuardedProtocol(H11Protocol):
        _deadline: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            if len(self.connections) >= limits.connections:
                transport.abort()
                self.transport = transport
                return
            super().connection_made(transport)
            self._expect()

        def connection_lost(self, exc: Exception | None) -> None:
            if self._deadline is not None:
                self._deadline.cancel()
            if self in self.connections:
                super().connection_lost(exc)

        def data_received(self, data: bytes) -> None:
            if self.transport.is_closing():
                return
            super().data_received(data)
            if self._idle and self._deadline is None:
                self._expect()

        @property
        def _idle(self) -> bool:
            """No request is being answered."""
            return self.cycle is None or bool(self.cycle.response_complete)

        def _expect(self) -> None:
            self._deadline = self.loop.call_later(limits.request_s, self._drop)

        def _drop(self) -> None:
            self._deadline = None
            if self.transport.get_protocol() is self and self._idle:
                self.transport.close()

    return GuardedProtocol
