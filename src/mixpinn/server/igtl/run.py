"""A bundle behind OpenIGTLink, from loading it to the end of the program."""

import asyncio
import ipaddress
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from mixpinn.base.errors import InputError
from mixpinn.server.igtl.connect import LOCAL, PORT, call, listen
from mixpinn.server.igtl.devices import FORCE, GRID, PROBE_MODEL, PROBE_START, SKIN, STATUS, TRUST, probe_devices
from mixpinn.server.igtl.probe import probe_messages
from mixpinn.server.igtl.publisher import Publisher
from mixpinn.server.igtl.stream import Stream, StreamConfig
from mixpinn.server.prompt_threads import prompt_threads
from mixpinn.serving.live import Friction, LiveSession
from mixpinn.serving.live.session import MOST_PROBES


@dataclass(frozen=True)
class StreamSettings:
    """Where peers are, and what they are sent.

    Attributes:
        host, port: where peers connect to; port 0 takes a free one.
        connect: host and port of a peer that listens; then nothing listens here.
        skin_points: send the skin at about so many points; None at all of them.
        grid_spacing: of the grid of displacements [mm].
        version: of the messages' header, 1 or 2.
        friction: whether friction remembers the way of the probes.
        rates: what is sent how often.
    """

    host: str = LOCAL
    port: int = PORT
    connect: tuple[str, int] | None = None
    skin_points: int | None = None
    grid_spacing: float = 10.0
    version: int = 1
    friction: Friction = Friction.REMEMBERED
    rates: StreamConfig = field(default_factory=StreamConfig)


def stream_bundle(
    bundle: Path | str, settings: StreamSettings, *, say: Callable[[str], None], warn: Callable[[str], None],
) -> None:
    """Serve a bundle until the program is stopped.

    Args:
        bundle: a hybrid model that takes poses.
        settings: where peers are, and what they are sent.
        say: called with what a user needs to know: addresses, devices, who comes and goes.
        warn: called with what speaks against the settings.

    Raises:
        InputError: settings that cannot be met, a bundle that takes no poses, or an address that cannot be used.
    """
    _check(settings)
    session = LiveSession.open(bundle, friction=settings.friction)
    try:
        session.predictor.read_ahead()
        publisher = Publisher(
            session.predictor.mesh, skin_points=settings.skin_points, spacing=settings.grid_spacing,
            version=settings.version,
        )
        if settings.connect is None and not _local(settings.host):
            warn(f"anyone who reaches {settings.host} can move the probe: OpenIGTLink knows no passwords")
        if not publisher.frame.known:
            warn(
                "this mesh says nothing of where its image was: RAS is its own frame turned to (x, −y, −z); make the "
                "mesh from label maps with 'mixpinn anatomy' and 'mixpinn mesh' for the image's"
            )
        for line in _devices(publisher, settings):
            say(line)
        with prompt_threads():
            asyncio.run(_run(session, publisher, settings, say))
    finally:
        session.close()


async def _run(
    session: LiveSession, publisher: Publisher, settings: StreamSettings, say: Callable[[str], None],
) -> None:
    def ready(port: int) -> None:
        say(f"OpenIGTLink: listening at {settings.host}:{port}")

    greeting = probe_messages(session, publisher.frame)
    async with Stream(session, publisher, settings.rates, greeting=greeting, tell=say) as stream:
        if settings.connect is None:
            await listen(stream, settings.host, settings.port, ready=ready)
        else:
            host, port = settings.connect
            say(f"OpenIGTLink: calling {host}:{port}")
            await call(stream, host, port, tell=say)


def _devices(publisher: Publisher, settings: StreamSettings) -> list[str]:
    rates = settings.rates
    skin = f"{SKIN} ({rates.skin_rate:g}/s)" if rates.skin_rate else f"{SKIN} (on request)"
    grid = f"{GRID} ({rates.grid_rate:g}/s)" if rates.grid_rate else f"{GRID} (on request)"
    return [
        f"takes TRANSFORM {', '.join(probe_devices(rates.probes))}: the probe's tip and axes in RAS [mm]",
        f"sends TRANSFORM {', '.join(publisher.devices.values())}: from rest to now in RAS [mm]",
        f"sends once POLYDATA {PROBE_MODEL} in the probe's own frame, TRANSFORM {PROBE_START}: where it may begin",
        f"sends POLYDATA {skin}, IMAGE {grid}, NDARRAY {FORCE}, STRING {TRUST}, STATUS {STATUS}",
    ]


def _check(settings: StreamSettings) -> None:
    rates = settings.rates
    for name, value, good, wanted in (
        ("--probes", rates.probes, 1 <= rates.probes <= MOST_PROBES, f"1 to {MOST_PROBES}"),
        ("--port", settings.port, 0 <= settings.port < 65536, "0 to 65535"),
        ("--skin-rate", rates.skin_rate, 0.0 <= rates.skin_rate <= 60.0, "0 to 60 a second"),
        ("--grid-rate", rates.grid_rate, 0.0 <= rates.grid_rate <= 10.0, "0 to 10 a second"),
        ("--protocol", settings.version, settings.version in (1, 2), "1 or 2"),
    ):
        if not good:
            raise InputError(name, expected=wanted, got=f"{value:g}", fix="choose another value")


def _local(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
