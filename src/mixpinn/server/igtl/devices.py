"""What each device is called on the line: at most 20 letters, each name once."""

from collections.abc import Sequence

from mixpinn.base.errors import InputError
from mixpinn.server.igtl.header import DEVICE_LENGTH

PROBE, SKIN, GRID, FORCE, TRUST, STATUS = "Probe", "Skin", "Displacement", "Force", "Trust", "MIXPINN"
"""Names of the devices that are not rigid parts."""
PROBE_MODEL, PROBE_START = "ProbeModel", "ProbeStart"
"""What every peer gets once: the probe's surface in its own frame, and a place at first touch to begin from."""


def probe_devices(count: int) -> tuple[str, ...]:
    """``Probe``, ``Probe2``, …: the transforms that move the probes."""
    return (PROBE, *(f"{PROBE}{number}" for number in range(2, count + 1)))


def part_devices(rigid_names: Sequence[str]) -> dict[str, str]:
    """Device of each rigid part: its name, cut to what the protocol holds.

    Raises:
        InputError: two parts whose names agree in their first letters, or a part that is called as another device.
    """
    devices = {name: name.encode("ascii", "replace").decode()[:DEVICE_LENGTH] for name in rigid_names}
    taken = list(devices.values())
    for name, device in devices.items():
        if taken.count(device) > 1 or device in (SKIN, GRID, FORCE, TRUST, STATUS) or device.startswith(PROBE):
            raise InputError(
                name, expected=f"names of rigid parts that differ in their first {DEVICE_LENGTH} letters",
                got=f"device name {device!r} twice", fix="name the parts otherwise when the mesh is made",
            )
    return devices
