"""Run a server: until it is interrupted, or beside other things in a thread of its own."""

import asyncio
import socket
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

import uvicorn

from mixpinn.base.errors import InputError
from mixpinn.server.app import make_app
from mixpinn.server.gate import Door
from mixpinn.server.http_protocol import AbortableProtocol, guarded_protocol
from mixpinn.server.limits import Limits
from mixpinn.server.prompt_threads import prompt_threads
from mixpinn.server.service import Service
from mixpinn.serving.load import AnyPredictor, load_predictor


class LiveServer:
    """A server of one bundle.

    Attributes:
        door: where it listens; the port is the real one once it runs.
        service: what its clients share.

    Example:
        >>> with LiveServer(load_predictor("runs/hybrid"), Door(port=0)) as server:
        ...     server.url.startswith("http://127.0.0.1:")
        True
    """

    def __init__(
        self, predictor: AnyPredictor, door: Door | None = None, *, limits: Limits | None = None, threads: int = 1,
        page: Mapping[str, tuple[str, bytes]] | None = None,
    ) -> None:
        """Bind the address; nothing is served yet.

        Args:
            predictor: a hybrid model that takes poses.
            door: where to listen and whom to let in.
            limits: of clients.
            threads: sessions that are answered at the same time.
            page: content type and bytes by path; by default the installed page.

        Raises:
            InputError: a network, a bundle without contact from the pose, or an address that is not free.
        """
        door = door or Door()
        self.service = Service(predictor, limits=limits, threads=threads)
        self._socket = _bind(door)
        self.door = Door(door.host, self._socket.getsockname()[1], door.token)
        limits = self.service.limits
        self._server = uvicorn.Server(uvicorn.Config(
            make_app(self.service, self.door, page=page), http=guarded_protocol(limits), ws=AbortableProtocol,
            ws_max_size=limits.message_bytes, ws_per_message_deflate=False, ws_ping_interval=20.0, ws_ping_timeout=20.0,
            h11_max_incomplete_event_size=16_384, timeout_keep_alive=30, timeout_graceful_shutdown=2, backlog=512,
            log_config=None, log_level="warning", access_log=False, server_header=False, date_header=False,
            lifespan="off", loop="asyncio",
        ))
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """Address of the page, without the token."""
        return f"http://{'[::1]' if self.door.host == '::1' else self.door.host}:{self.door.port}/"

    def run(self, ready: Callable[[], None] | None = None) -> None:
        """Serve until interrupted, in the main thread; or until `stop` is called, in another."""
        try:
            with prompt_threads():
                asyncio.run(self._serve(ready))
        finally:
            self.service.close()
            self._socket.close()

    def start(self) -> None:
        """Serve in a thread of its own; returns once requests are answered."""
        ready = threading.Event()
        self._thread = threading.Thread(target=self.run, args=(ready.set,), name="mixpinn-server", daemon=True)
        self._thread.start()
        if not ready.wait(30.0):
            raise InputError(self.url, expected="a server that starts", got="none after 30 s", fix="try another port")

    def stop(self) -> None:
        """End it."""
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join()

    def __enter__(self) -> "LiveServer":
        self.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.stop()

    async def _serve(self, ready: Callable[[], None] | None) -> None:
        serving = asyncio.create_task(self._server.serve(sockets=[self._socket]))
        while not self._server.started and not serving.done():
            await asyncio.sleep(0.01)
        if ready is not None and self._server.started:
            ready()
        await serving


def serve(
    bundle: Path | str, door: Door, *, ready: Callable[[LiveServer], None] | None = None, threads: int = 1,
) -> None:
    """Serve a bundle until interrupted.

    Args:
        bundle: folder of a hybrid bundle that takes poses.
        door: where to listen and whom to let in.
        ready: called once requests are answered.
        threads: sessions that are answered at the same time.

    Raises:
        InputError: a bundle that cannot press, or an address that is not free.
    """
    # Bundles are often called the same: the folder above tells whose it is.
    name = "/".join(Path(bundle).resolve().parts[-2:])
    server = LiveServer(load_predictor(bundle, name=name), door, threads=threads)
    server.run(None if ready is None else lambda: ready(server))


def _bind(door: Door) -> socket.socket:
    family = socket.AF_INET6 if ":" in door.host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_STREAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((door.host, door.port))
    except OSError as error:
        bound.close()
        raise InputError(
            f"{door.host}:{door.port}", expected="an address that is free", got=error.strerror or str(error),
            fix="choose another --port (0 takes any), or another --host",
        ) from error
    bound.set_inheritable(True)
    return bound
