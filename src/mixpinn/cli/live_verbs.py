"""The verbs of live sessions: serve."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mixpinn.cli.data_verbs import app
from mixpinn.cli.output import say

if TYPE_CHECKING:
    from mixpinn.server.run import LiveServer

Bundle = Annotated[Path, typer.Argument(help="Hybrid bundle that takes poses ('mixpinn train --model hybrid').")]
Port = Annotated[int, typer.Option(help="Port; 0 takes any that is free.")]
Host = Annotated[str, typer.Option(help="Address to listen on; beyond this machine it demands a token.")]
Token = Annotated[str | None, typer.Option(envvar="MIXPINN_TOKEN", help="What every request must bring.")]


@app.command()
def serve(bundle: Bundle, port: Port = 8321, host: Host = "127.0.0.1", token: Token = None) -> None:
    """Answer poses live, over WebSocket and HTTP, until interrupted."""
    from mixpinn.server.gate import Door
    from mixpinn.server.run import serve as run

    door = Door(host, port, token)

    def ready(server: "LiveServer") -> None:
        say(f"Serving {bundle} at {server.url} (interrupt to end)")

    run(bundle, door, ready=ready)
