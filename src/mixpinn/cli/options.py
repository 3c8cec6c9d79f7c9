"""Options that several verbs share, and how settings come from file, option and ``--set``."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mixpinn.base.config import build_config, parse_overrides, read_config_file
from mixpinn.base.errors import InputError

if TYPE_CHECKING:
    from mixpinn.records import TissueMesh
    from mixpinn.stages.simulation import SimulationConfig

_FARTHEST = 10_000.0
"""A coordinate beyond this [mm] is no place of a probe."""

Protocol = Annotated[str | None, typer.Option(help="paper, anatomy, small, tiny or sofa-replay.")]
ProbeFile = Annotated[Path | None, typer.Option(help="Probe surface (.stl), tip at the origin, pointing to −y.")]
Positions = Annotated[Path | None, typer.Option(help="File with one probe position a line.")]
Rigid = Annotated[list[str] | None, typer.Option(help="A rigid structure; repeatable. Every bone in the crop.")]
Target = Annotated[
    list[str] | None, typer.Option(help="A rigid part that the crop follows; repeatable. Lumbar vertebrae."),
]
PaperParts = Annotated[bool, typer.Option("--paper-parts", help="Only lumbar vertebrae are rigid, as in the paper.")]
Layers = Annotated[bool, typer.Option("--layers", help="Take fat, muscle and discs among the maps as tissues.")]
CtFile = Annotated[Path | None, typer.Option("--ct", help="CT of the maps: fat and muscle by windows of HU.")]
Joints = Annotated[str | None, typer.Option(help="Joints between vertebrae: none, in-vitro or in-vivo-prone.")]
Front = Annotated[str | None, typer.Option("--support", help="What the front rests on: anterior, table or free.")]
Hold = Annotated[list[str] | None, typer.Option(help="A rigid part that is held in place; repeatable.")]
Caps = Annotated[str | None, typer.Option(help="Caps of the crop: free, sliding or held.")]
Skin = Annotated[str | None, typer.Option("--membrane", help="The skin as a membrane: none, tension or elastic.")]
PaperConstants = Annotated[bool, typer.Option(help="Tissue constants of the paper's fields.")]
MeshSource = Annotated[Path, typer.Argument(help="Folder that 'mixpinn mesh' wrote, or its mesh.vtu.")]
Out = Annotated[Path, typer.Option("--out", "-o", help="Run directory; an unfinished run in it continues.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", help="Override a setting, for example train.max_epochs=20; repeatable."),
]
Config = Annotated[Path | None, typer.Option("--config", "-c", help="Settings as TOML or JSON.")]
SplitFile = Annotated[Path | None, typer.Option("--split", help="Split of the positions as JSON, or every-fifth.")]
HoldOut = Annotated[
    str | None, typer.Option(help="Hold-out: rotation-45, rotation-135, deep, lateral, caudal or noise."),
]
Threads = Annotated[int | None, typer.Option(help="CPU threads; every core by default.")]


def settings_layers(config: Path | None, overrides: list[str] | None, **options: Any) -> list[dict[str, Any]]:
    """Settings by file, then by option, then by --set."""
    return [
        read_config_file(config) if config else {},
        {key: value for key, value in options.items() if value is not None},
        parse_overrides(overrides or []),
    ]


def read_tip(text: str) -> tuple[float, float, float]:
    """The place of a probe's tip [mm] from 'x,y,z'.

    Raises:
        InputError: not three finite numbers, or a place more than 10 m from the body.
    """
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise InputError(
            "tip", expected="three numbers 'x,y,z' [mm]", got=repr(text), fix="for example --tip=-10,120.5,35",
        )
    if max(abs(x), abs(y), abs(z)) > _FARTHEST:
        raise InputError(
            "tip", expected=f"a place within {_FARTHEST / 1e3:.0f} m of the body [mm]", got=repr(text),
            fix="check the unit; the world's origin is the middle of the body",
        )
    return x, y, z


def load_mesh(source: Path) -> "TissueMesh":
    """The mesh inside the run directory of `mesh`, or the file itself."""
    from mixpinn.stages import mesh

    return mesh.load_mesh(source)


def role_options(
    rigid: list[str] | None, target: list[str] | None, paper_parts: bool, layers: bool, ct: Path | None,
) -> dict[str, Any]:
    """Settings of rigid parts and layers from options; empty where none is given."""
    given = {
        "rigid": rigid and tuple(rigid), "target": target and tuple(target), "paper_parts": paper_parts or None,
        "layers": layers or None, "ct": ct and str(ct),
    }
    return {key: value for key, value in given.items() if value is not None}


def restraint_options(
    joints: str | None, front: str | None, hold: list[str] | None, caps: str | None, membrane: str | None,
) -> dict[str, Any]:
    """Settings of joints, supports and skin from options; empty where none is given."""
    support = {"front": front, "held": hold and tuple(hold), "caps": caps}
    given = {key: value for key, value in support.items() if value is not None}
    named = {"joints": joints, "membrane": membrane, "support": given or None}
    return {key: value for key, value in named.items() if value is not None}


def simulation_settings(
    config: Path | None, overrides: list[str] | None, *, protocol: str | None, probe: Path | None,
    positions: Path | None, paper_constants: bool, workers: int | None = None,
    restraints: dict[str, Any] | None = None,
) -> "SimulationConfig":
    """Settings of the simulation from file and options."""
    from mixpinn.dataset import PROTOCOLS
    from mixpinn.stages.simulation import PAPER_TISSUE_CONFIG, SimulationConfig

    if protocol is not None and protocol not in PROTOCOLS:
        raise InputError(
            f"--protocol {protocol}", expected="one of " + ", ".join(PROTOCOLS), got=protocol, fix="choose one of them",
        )
    return build_config(SimulationConfig, *settings_layers(
        config, overrides, protocol=protocol and asdict(PROTOCOLS[protocol]), probe=probe and str(probe),
        positions=positions and str(positions), workers=workers,
        tissue=asdict(PAPER_TISSUE_CONFIG) if paper_constants else None, **(restraints or {}),
    ))
