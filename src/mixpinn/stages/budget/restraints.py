"""What joints and supports decide: the scenes of other settings than the bundle's own."""

import contextlib
from dataclasses import replace
from functools import partial

from mixpinn.base.errors import InputError
from mixpinn.fem import Scene
from mixpinn.mesh import FixedRegion, fixed_nodes
from mixpinn.physics.foundation import Face
from mixpinn.physics.joint_system import Joint
from mixpinn.records.error_budget import BudgetKind
from mixpinn.stages.budget.variant import Variant
from mixpinn.stages.restraints import TABLE, JointChoice, joints_between

JOINTS, SUPPORT, HELD = "joints", "support", "held bones"


def restraint_variants(base: Scene) -> list[Variant]:
    """The scene with other joints, on another support, and with its held bones let go, as far as they apply.

    A body without joints is given those of a patient; one with joints loses them, or gets the other preset's.
    """
    return [*_other_joints(base), *_other_support(base), *_freed_bones(base)]


def _other_joints(base: Scene) -> list[Variant]:
    choices: dict[JointChoice, tuple[Joint, ...]] = {}
    for choice in (("none", "in-vitro", "in-vivo-prone") if base.joints else ("in-vivo-prone",)):
        with contextlib.suppress(InputError):  # vertebrae whose end plates are not found
            choices[choice] = joints_between(base.mesh.with_order(1), choice)
    return [
        Variant(JOINTS, BudgetKind.SENSITIVITY, choice, partial(replace, base, joints=joints))
        for choice, joints in choices.items() if joints != base.joints
    ]


def _other_support(base: Scene) -> list[Variant]:
    mesh, others = base.mesh, tuple(one for one in base.foundations if one.face is not Face.FRONT)
    if len(others) < len(base.foundations):
        fixed = mesh.fixed | fixed_nodes(mesh, region=FixedRegion.of(mesh.points))
        value, foundations = "anterior", others
    else:
        fixed = mesh.fixed & (mesh.part > 0)
        value, foundations = "table", (TABLE, *others)
    return [Variant(
        SUPPORT, BudgetKind.SENSITIVITY, value,
        lambda: replace(base, mesh=replace(mesh, fixed=fixed), foundations=foundations),
    )]


def _freed_bones(base: Scene) -> list[Variant]:
    mesh = base.mesh
    left = mesh.fixed & (mesh.part == 0)
    rests = left.any() or any(one.face is Face.FRONT for one in base.foundations)
    if not mesh.held_parts.any() or not rests:
        return []
    return [Variant(
        HELD, BudgetKind.SENSITIVITY, "free", lambda: replace(base, mesh=replace(mesh, fixed=left)),
    )]


def restraints_present(source: str, base: Scene) -> str:
    """What the bundle has of one of these sources, in words."""
    if source == JOINTS:
        for choice in ("in-vitro", "in-vivo-prone"):
            with contextlib.suppress(InputError):
                if base.joints and joints_between(base.mesh.with_order(1), choice) == base.joints:
                    return choice
        return "its own" if base.joints else "none"
    if source == SUPPORT:
        return "table" if any(one.face is Face.FRONT for one in base.foundations) else "anterior"
    names = zip(base.mesh.rigid_names, base.mesh.held_parts, strict=True)
    return ", ".join(name.removeprefix("vertebrae_") for name, held in names if held)
