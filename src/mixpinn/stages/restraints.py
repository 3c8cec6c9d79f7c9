"""Settings of what ties a body besides its tissue: joints between vertebrae, and what it rests on."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.progress import console
from mixpinn.fem.rigid.joint_presets import JointPreset, preset_joints, with_figures
from mixpinn.mesh.joint_frames import joint_frames, neighbours
from mixpinn.physics.foundation import Face, Foundation, cap_nodes
from mixpinn.physics.joint_system import Joint
from mixpinn.physics.restraints import Restraints
from mixpinn.records import TissueMesh
from mixpinn.records.joint_frame import JointFrame, load_joint_frames

JointChoice = Literal["auto", "none", "in-vitro", "in-vivo-prone"]

FOAM_MODULUS, FOAM_THICKNESS = 15e-3, 50.0
"""Young's modulus [N/mm²] and thickness [mm] of the pad of an examination table.

Modulus: the stiffer of the two foams, 5 and 15 kPa, in table 3 of doi:10.1111/iwj.12877 (PMC7949503; the table was
read). The thickness is an assumption; tables and mattresses have 30 to 150 mm. Together 0.3 N/mm³ × 10⁻³, range 0.03
to 0.5.
"""
INTERFACE_PRESSURE = 2.3e-3
"""Mean pressure between a lying body and a mattress [N/mm²], from which the rest depth follows.

17.5 mmHg, the middle of 15 to 20 mmHg over eleven foam mattresses, on people lying supine: M. H. E. Hermans et al.,
WOCN 2010, paper 4942 (abstract). Prone it was not found.
"""
TABLE = Foundation(
    Face.FRONT, FOAM_MODULUS / FOAM_THICKNESS, shear=0.5 * FOAM_MODULUS / FOAM_THICKNESS,
    sink=INTERFACE_PRESSURE * FOAM_THICKNESS / FOAM_MODULUS,
)
"""A foam pad under the front: E / h along, G / h = E / 2h across (open foam, ν = 0); the body lies p h / E = 7.7 mm
deep in it at rest."""
SLIDING_CAPS = Foundation(Face.CAPS, 1.0)
"""Caps that slide in their planes: 1 N/mm³ along z, some thousand times what the tissue behind them has."""


@dataclass(frozen=True)
class SupportConfig:
    """What the body rests on.

    Attributes:
        front: ``anterior``: the nodes that the mesh has fixed, in the paper a region of the front; ``table``: a foam
            pad under the front, which lets go where skin rises off it; ``free``: nothing.
        held: rigid parts that are held in place, besides those that the crop cut.
        cut: rigid parts that the crop cut are ``held`` where they leave it, or ``free``.
        caps: of the crop: ``free``, ``sliding`` in their planes, or ``held``.
    """

    front: Literal["anterior", "table", "free"] = "anterior"
    held: tuple[str, ...] = ()
    cut: Literal["held", "free"] = "held"
    caps: Literal["free", "sliding", "held"] = "free"


AS_MESHED = SupportConfig()


def supported(mesh: TissueMesh, config: SupportConfig) -> tuple[TissueMesh, tuple[Foundation, ...]]:
    """The mesh with the nodes fixed that `config` says, and the foundations under its skin.

    Raises:
        InputError: a part that the mesh does not have, or nothing that holds the body.
    """
    unknown = [name for name in config.held if name not in mesh.rigid_names]
    if unknown:
        raise InputError(
            f"support.held: {unknown[0]}", expected="rigid parts of the mesh: " + ", ".join(mesh.rigid_names),
            got="another name", fix="name a part of the mesh",
        )
    fixed, soft = mesh.fixed.copy(), mesh.part == 0
    if config.front != "anterior":
        fixed[soft] = False
    if config.cut == "free":
        fixed[~soft] = False
    for name in config.held:
        fixed[mesh.part == mesh.rigid_names.index(name) + 1] = True
    if config.caps == "held":
        fixed[soft & cap_nodes(mesh.with_order(1))] = True
    foundations = ((TABLE,) if config.front == "table" else ()) + ((SLIDING_CAPS,) if config.caps == "sliding" else ())
    if not fixed.any() and config.front != "table":
        raise InputError(
            "support", expected="something that holds the body", got="nothing",
            fix="choose front anterior or table, held parts, or held caps",
        )
    changed = not np.array_equal(fixed, mesh.fixed)
    return replace(mesh, fixed=fixed) if changed else mesh, foundations


def joints_between(mesh: TissueMesh, choice: JointChoice, *, frames: str | None = None) -> tuple[Joint, ...]:
    """Joints of a preset between the bones of a mesh that articulate and that the preset has figures for.

    A pair whose frame cannot be found from the anatomy is left out, with a warning that says why.

    Args:
        mesh: the mesh.
        choice: the preset; ``auto`` where nobody has settled it is none.
        frames: file of joint frames; by default they come from the anatomy of the mesh.

    Raises:
        InputError: not one frame can be found, or discs are labelled as a tissue.
    """
    if choice in ("auto", JointPreset.NONE):
        return ()
    if frames is not None:
        found = tuple(frame for frame in load_joint_frames(frames) if with_figures(frame.first, frame.second))
    else:
        found = _frames_found(mesh)
    return preset_joints(found, choice)


def _frames_found(mesh: TissueMesh) -> tuple[JointFrame, ...]:
    found: list[JointFrame] = []
    missed: list[InputError] = []
    for pair in neighbours(mesh):
        if with_figures(*pair):
            try:
                found += joint_frames(mesh, between=[pair])
            except InputError as error:
                missed.append(error)
    if missed and not found:
        raise missed[0]
    for reason in missed:
        console.print(f"[yellow]warning[/]: no joint there: {reason}", soft_wrap=True)
    return tuple(found)


def settled_joints(choice: JointChoice, soft_names: Sequence[str]) -> JointChoice:
    """The choice for a patient: ``auto`` becomes ``in-vivo-prone``, or ``none`` where discs are a tissue.

    Args:
        choice: what the settings say.
        soft_names: the soft tissues that are labelled.
    """
    if choice != "auto":
        return choice
    return "none" if any("disc" in name.lower() for name in soft_names) else "in-vivo-prone"


def settings_of_restraints(mesh: TissueMesh, restraints: Restraints) -> tuple[JointChoice, SupportConfig]:
    """The settings that give these joints and foundations on a mesh that is already supported as it should be.

    Raises:
        InputError: joints or foundations that no setting names.
    """
    faces = {foundation.face: foundation for foundation in restraints.foundations}
    if not set(restraints.foundations) <= {TABLE, SLIDING_CAPS}:
        raise _no_setting("foundations")
    caps: Literal["free", "sliding", "held"] = "sliding" if Face.CAPS in faces else "free"
    on_cap = mesh.fixed & (mesh.part == 0) & cap_nodes(mesh.with_order(1))
    if Face.FRONT in faces and on_cap.any():
        caps = "held"
    support = SupportConfig(front="table" if Face.FRONT in faces else "anterior", caps=caps)
    if not restraints.joints:
        return "none", support
    choices: tuple[JointChoice, ...] = ("in-vivo-prone", "in-vitro")
    for choice in choices:
        with contextlib.suppress(InputError):
            if joints_between(mesh, choice) == restraints.joints:
                return choice, support
    raise _no_setting("joints")


def _no_setting(what: str) -> InputError:
    return InputError(
        "further simulations with the settings of a store", expected=f"{what} that settings can name",
        got=f"{what} of your own", fix="simulate them with a scene in Python (mixpinn.simulate)",
    )


def describe(mesh: TissueMesh, restraints: Restraints) -> dict[str, str]:
    """Joints and supports in words, by what they are."""
    held = [name for name, still in zip(mesh.rigid_names, mesh.held_parts, strict=True) if still]
    skin = int((mesh.fixed & (mesh.part == 0)).sum())
    faces = {foundation.face: foundation for foundation in restraints.foundations}
    lines = []
    if skin:
        lines.append(f"{skin} soft nodes held in place")
    if Face.FRONT in faces:
        pad = faces[Face.FRONT]
        end = "both ways" if pad.sink is None else f"lifts off after {pad.sink:.1f} mm"
        lines.append(f"front on a pad of {1e3 * pad.stiffness:.2g} kPa/mm ({end})")
    if Face.CAPS in faces:
        lines.append("caps slide in their planes")
    if held:
        lines.append("held bones: " + ", ".join(held))
    count = len(restraints.joints)
    names = ", ".join(joint.frame.name.replace("vertebrae_", "") for joint in restraints.joints)
    tied = {(joint.frame.first, joint.frame.second) for joint in restraints.joints}
    loose = ", ".join(
        f"{second}-{first}".replace("vertebrae_", "") for first, second in neighbours(mesh)
        if (first, second) not in tied and with_figures(first, second)
    )
    without = f"; none found for {loose}" if count and loose else ""
    sheet = restraints.membrane
    stretched = {} if sheet is None else {
        "Skin": f"a membrane under {1e3 * sheet.tension:.3g} N/m" + (
            f", {3.0 * sheet.shear:.3g} N/mm against stretch" if sheet.shear else ""
        ),
    }
    return stretched | {
        "Supports": "; ".join(lines) or "nothing",
        "Joints": f"{count}: {names}{without}" if count else "none, rigid parts float in the tissue",
    }
