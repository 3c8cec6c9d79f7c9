"""The verbs of live sessions: serve, view."""

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mixpinn.cli.data_verbs import app
from mixpinn.cli.output import say, warn

if TYPE_CHECKING:
    from mixpinn.server.run import LiveServer

Bundle = Annotated[Path, typer.Argument(help="Hybrid bundle that takes poses ('mixpinn train --model hybrid').")]
Port = Annotated[int, typer.Option(help="Port; 0 takes any that is free.")]
Host = Annotated[str, typer.Option(help="Address to listen on; beyond this machine it demands a token.")]
Token = Annotated[str | None, typer.Option(envvar="MIXPINN_TOKEN", help="What every request must bring.")]


@contextlib.contextmanager
def _until_interrupted() -> Iterator[None]:
    """An interruption is how a server ends: one line, and no error."""
    try:
        yield
    except KeyboardInterrupt:
        print("mixpinn: stopped serving", file=sys.stderr)


@app.command()
def serve(bundle: Bundle, port: Port = 8321, host: Host = "127.0.0.1", token: Token = None) -> None:
    """Answer poses live, over WebSocket and HTTP, until interrupted."""
    from mixpinn.server.gate import Door
    from mixpinn.server.run import serve as run

    door = Door(host, port, token)

    def ready(server: "LiveServer") -> None:
        say(f"Serving {bundle} at {server.url} (interrupt to end)")

    with _until_interrupted():
        run(bundle, door, ready=ready)


@app.command()
def view(
    bundle: Bundle, port: Port = 8321,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
) -> None:
    """Press the body in a browser: the server on this machine and its page, until interrupted."""
    import webbrowser

    from mixpinn.server.gate import Door
    from mixpinn.server.run import serve as run

    def ready(server: "LiveServer") -> None:
        if browser and not webbrowser.open(server.url):
            warn(f"no browser was found; open {server.url} in one")
        say(f"{bundle} at {server.url} (interrupt to end)")

    with _until_interrupted():
        run(bundle, Door(port=port), ready=ready)
