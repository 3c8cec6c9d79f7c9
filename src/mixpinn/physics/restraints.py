"""Restraints: what ties a body besides the tissue of its cells."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from mixpinn.base.validated import checked_record
from mixpinn.physics.foundation import Foundation
from mixpinn.physics.joint_record import joints_of
from mixpinn.physics.joint_system import Joint
from mixpinn.physics.membrane import Membrane
from mixpinn.records.plain import KIND, plain

JOINTS, FOUNDATIONS, MEMBRANE = "joints", "foundations", "membrane"
"""Entries of a record, absent where there are none."""
_REMAKE = "make it again"
T = TypeVar("T")


@dataclass(frozen=True)
class Restraints:
    """Joints between rigid parts, foundations under the skin, and its membrane; held nodes are the mesh's own.

    Attributes:
        joints: between rigid parts.
        foundations: under the skin.
        membrane: of the skin.
    """

    joints: tuple[Joint, ...] = ()
    foundations: tuple[Foundation, ...] = ()
    membrane: Membrane | None = None

    def record(self) -> dict[str, Any]:
        """Plain values; empty where there is nothing."""
        entries = {JOINTS: self.joints, FOUNDATIONS: self.foundations, MEMBRANE: self.membrane}
        return {key: plain(value) for key, value in entries.items() if value}

    @staticmethod
    def of_record(record: Mapping[str, Any], where: str) -> "Restraints":
        """What `record` made, or a record that holds it among other entries.

        Args:
            record: plain values.
            where: whose they are, for the message.

        Raises:
            InputError: a law of the user's own, or a damaged entry.
        """
        joints, foundations = (
            checked_record(list[dict[str, Any]], record.get(key, []), f"{where}: {key}", remake=_REMAKE, finite=False)
            for key in (JOINTS, FOUNDATIONS)
        )
        membrane = record.get(MEMBRANE)
        return Restraints(
            joints_of(joints, where), tuple(_checked(Foundation, entry, where) for entry in foundations),
            None if membrane is None else _checked(Membrane, membrane, where),
        )


def _checked(kind: type[T], entry: Any, where: str) -> T:
    """The object of a built-in class that its plain values stand for."""
    values = {key: value for key, value in entry.items() if key != KIND} if isinstance(entry, Mapping) else entry
    return checked_record(kind, values, where, remake=_REMAKE)


FREE = Restraints()
"""Nothing but tissue."""
