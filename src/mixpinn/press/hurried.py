"""HurriedContact: contact for live use, that says soon where a drag cannot be followed, instead of trying on."""

from typing import Self

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.press.contact import PriorContact
from mixpinn.press.records import ContactHistory, PlacedFields
from mixpinn.press.session import ContactSession

_ENOUGH = 90
"""Tries after which a drag is given up: the straight way down takes about as much time as these."""


class LostTrackError(Exception):
    """A drag cannot be followed in time."""


class HurriedContact(PriorContact):
    """The same contact as another one, with less patience.

    A drag whose steps converge badly can take twenty times as long as the straight way down from first touch. A step
    that does not converge, or one try too many, ends it: its halves seldom help, and take longer than that way.
    """

    @classmethod
    def of(cls, contact: PriorContact) -> Self:
        """Of another contact, with which it shares everything."""
        hurried = cls.__new__(cls)
        hurried.__dict__.update(contact.__dict__)
        return hurried

    def _session(
        self, placed: PlacedFields, faces: IntArray, depths: FloatArray, history: ContactHistory | None,
    ) -> ContactSession:
        """As another contact's; its steps raise `LostTrackError`."""
        return _HurriedSession(**vars(super()._session(placed, faces, depths, history)))


class _HurriedSession(ContactSession):
    """A session that is given up soon."""

    @property
    def patience(self) -> int:
        """The most tries from here on."""
        return max(_ENOUGH + 1 - self.tries, 0)

    def _divided(self, path: tuple[FloatArray, FloatArray], shifts: FloatArray, cuts: int) -> ContactSession:
        raise LostTrackError

    def _steps(
        self, path: tuple[FloatArray, FloatArray], shifts: FloatArray, friction: float,
    ) -> tuple[ContactSession, int]:
        session, done = super()._steps(path, shifts, friction)
        if session.tries > _ENOUGH:
            raise LostTrackError
        return session, done
