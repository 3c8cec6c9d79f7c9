"""Restraints: what ties a body besides the tissue of its cells."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mixpinn.base.validated import checked_record
from mixpinn.physics.foundation import Foundation
from mixpinn.physics.joint_record import joints_of
from mixpinn.physics.joint_system import Joint
from mixpinn.records.plain import KIND, plain

JOINTS, FOUNDATIONS = "joints", "foundations"
"""Entries of a record, absent where there are none."""
_REMAKE = "make it again"


@dataclass(frozen=True)
class Restraints:
    """Joints between rigid parts, and foundations under the skin; nodes that are held are the mesh's own.

    Attributes:
        joints: between rigid parts.
        foundations: under the skin.
    """

    joints: tuple[Joint, ...] = ()
    foundations: tuple[Foundation, ...] = ()

    def record(self) -> dict[str, Any]:
        """Plain values; empty where there is nothing."""
        entries = {JOINTS: self.joints, FOUNDATIONS: self.foundations}
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
        return Restraints(joints_of(joints, where), tuple(
            checked_record(
                Foundation, {key: value for key, value in entry.items() if key != KIND}, where, remake=_REMAKE,
            )
            for entry in foundations
        ))


FREE = Restraints()
"""Nothing but tissue."""
