"""Who may ask: names of the host, pages of other origins, the token, and headers that keep the page to itself."""

import hmac
import ipaddress
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs, urlsplit

from mixpinn.base.errors import InputError

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_LOCAL = ("127.0.0.1", "localhost", "::1")
_GUARDED = ("/api/", "/live", "/download/")
"""What needs the token; the page itself says nothing of a patient."""
_HEADERS = (
    (b"content-security-policy", b"default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
     b"worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"),
    (b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"), (b"cross-origin-opener-policy", b"same-origin"),
)


@dataclass(frozen=True)
class Door:
    """Where a server listens and what it demands.

    Attributes:
        host: address or name.
        port: 0 lets the system choose.
        token: that every request must bring; None demands none.
    """

    host: str = "127.0.0.1"
    port: int = 8321
    token: str | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise InputError("port", expected="0 to 65535", got=str(self.port), fix="choose another port")
        token = self.token
        if token is not None and (len(token) < 16 or not token.isascii() or not token.isprintable()):
            raise InputError(
                "token", expected="at least 16 printable ASCII characters", got=f"{len(token)} characters",
                fix="take a longer one, for example that of 'python -c \"import secrets; print(secrets.token_hex())\"'",
            )
        if not self.local and self.token is None:
            raise InputError(
                f"host {self.host}", expected="a token, since other machines can reach this server", got="none",
                fix="give --token, or serve on 127.0.0.1",
            )

    @property
    def local(self) -> bool:
        """Whether only this machine can reach it."""
        return self.host in _LOCAL

    def knows(self, name: str) -> bool:
        """Whether the ``Host`` of a request, without its port, is this server's.

        A page of another site whose name was bound to this address later on brings its own name and is refused.
        """
        if self.local:
            return name in _LOCAL
        if name in (*_LOCAL, self.host.lower(), socket.gethostname().lower()):
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True


class Gate:
    """ASGI middleware that lets requests through, or refuses them before anything is done."""

    def __init__(self, app: App, door: Door) -> None:
        """Guard `app` as `door` demands."""
        self._app, self._door = app, door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request through, or answer 400, 401 or 403."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refused = self._refusal(scope)
        if refused is None:
            await self._app(scope, receive, send if scope["type"] == "websocket" else _with_headers(send))
        elif scope["type"] == "http":
            await refuse(send, *refused)
        else:
            await receive()  # the request to connect
            await refuse(send, *refused, kind="websocket.http.response")

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Status and reason, if the request is refused."""
        headers: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.lower(), []).append(value)
        hosts = headers.get(b"host", [])
        host = hosts[0].decode("latin-1").lower() if len(hosts) == 1 else ""
        name = _without_port(host)
        if name is None or not self._door.knows(name):
            return 400, "this server does not go by that name"
        origins = headers.get(b"origin", [])
        if origins and (len(origins) > 1 or not _same_origin(origins[0].decode("latin-1").lower(), host)):
            return 403, "pages of other origins may not ask"
        if b"transfer-encoding" in headers or headers.get(b"content-length", [b"0"]) != [b"0"]:
            return 400, "requests have no body here"
        guarded = scope["path"].startswith(_GUARDED)
        if guarded and headers.get(b"sec-fetch-site", [b"same-origin"])[0] == b"cross-site":
            return 403, "pages of other sites may not ask"
        if self._door.token is not None and guarded:
            brought = headers.get(b"authorization", [b""])[0].removeprefix(b"Bearer ")
            asked = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0].encode("latin-1", "replace")
            expected = self._door.token.encode()
            if not (hmac.compare_digest(brought, expected) or hmac.compare_digest(asked, expected)):
                return 401, "the token is missing or wrong"
        return None


async def refuse(send: Send, status: int, reason: str, *, kind: str = "http.response") -> None:
    """Answer with a status and one line of text."""
    body = (reason + "\n").encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode()),
               (b"connection", b"close"), *_HEADERS]
    await send({"type": f"{kind}.start", "status": status, "headers": headers})
    await send({"type": f"{kind}.body", "body": body})


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", []), *_HEADERS]
        await send(message)

    return sending


def _without_port(host: str) -> str | None:
    """The name in ``name:port`` or ``[address]:port``."""
    try:
        return urlsplit(f"//{host}").hostname if host and "@" not in host and "/" not in host else None
    except ValueError:
        return None


def _same_origin(origin: str, host: str) -> bool:
    return origin in (f"http://{host}", f"https://{host}")
