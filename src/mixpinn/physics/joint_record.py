"""Joints as plain values, and back."""

from collections.abc import Iterable, Mapping
from typing import Any

from mixpinn.base.errors import InputError
from mixpinn.physics.joint_system import Joint
from mixpinn.physics.joints import LinearBushing, NeutralZoneBushing
from mixpinn.records.joint_frame import joint_frame_from
from mixpinn.records.plain import KIND

JOINT_LAWS: dict[str, type[LinearBushing | NeutralZoneBushing]] = {
    law.__name__: law for law in (LinearBushing, NeutralZoneBushing)
}
"""Laws of joints that a record can be turned back into."""


def joints_of(entries: Iterable[Any], where: str) -> tuple[Joint, ...]:
    """Joints from what `mixpinn.records.plain.plain` made of them.

    Args:
        entries: one for each joint.
        where: whose record it is, for the message.

    Raises:
        InputError: a law of the user's own, which the record names but cannot rebuild, or a damaged entry.
    """
    return tuple(_joint(entry, where) for entry in entries)


def _joint(entry: Any, where: str) -> Joint:
    law = entry.get("law") if isinstance(entry, Mapping) else None
    kind = law.get(KIND) if isinstance(law, Mapping) else law
    if not isinstance(law, Mapping) or kind not in JOINT_LAWS:
        raise InputError(
            where, expected="joints of " + ", ".join(JOINT_LAWS), got=f"the class {kind!r}, which is not built in",
            fix="build the scene in Python with the joints' own laws (Scene(..., joints=...))",
        )
    constants = {key: value for key, value in law.items() if key != KIND}
    try:
        return Joint(joint_frame_from(entry.get("frame"), where), JOINT_LAWS[str(kind)](**constants))
    except TypeError as error:
        raise InputError(
            where, expected=f"the constants of a {kind}", got=str(error), fix="simulate again",
        ) from error
