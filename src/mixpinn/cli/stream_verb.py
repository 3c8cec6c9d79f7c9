"""The verb that puts a bundle behind OpenIGTLink: stream."""

from pathlib import Path
from typing import Annotated

import typer

from mixpinn.cli.data_verbs import app
from mixpinn.cli.output import warn


@app.command()
def stream(
    bundle: Annotated[Path, typer.Argument(help="Hybrid model that takes poses.")],
    port: Annotated[int, typer.Option(help="Port to listen at; 0 takes a free one.")] = 18944,
    host: Annotated[str, typer.Option(help="Address to listen at; beyond this machine only if you say so.")] = (
        "127.0.0.1"
    ),
    connect: Annotated[str | None, typer.Option(help="Call a peer at host:port instead, again and again.")] = None,
    probes: Annotated[int, typer.Option(help="Probes that can be moved: Probe, Probe2, …")] = 1,
    skin_points: Annotated[int | None, typer.Option(help="Send the skin at about so many points; all of them.")] = None,
    skin_rate: Annotated[float, typer.Option(help="Skins a second; 0 sends them on request only.")] = 10.0,
    grid: Annotated[float, typer.Option(help="Spacing of the grid of displacements [mm].")] = 10.0,
    grid_rate: Annotated[float, typer.Option(help="Grids a second; 0 sends them on request only.")] = 0.0,
    straight: Annotated[bool, typer.Option("--straight", help="Friction does not remember the probe's way.")] = False,
    protocol: Annotated[int, typer.Option(help="Version of the messages' header, 1 or 2.")] = 1,
) -> None:
    """Poses in, deformation out over OpenIGTLink, for 3D Slicer and others; runs until it is stopped."""
    from mixpinn.server.igtl.connect import address
    from mixpinn.server.igtl.run import StreamSettings, stream_bundle
    from mixpinn.server.igtl.stream import StreamConfig
    from mixpinn.serving.live import Friction

    settings = StreamSettings(
        host=host, port=port, connect=None if connect is None else address(connect), skin_points=skin_points,
        grid_spacing=grid, version=protocol, friction=Friction.STRAIGHT if straight else Friction.REMEMBERED,
        rates=StreamConfig(probes=probes, skin_rate=skin_rate, grid_rate=grid_rate),
    )
    stream_bundle(bundle, settings, say=lambda line: print(line, flush=True), warn=warn)
