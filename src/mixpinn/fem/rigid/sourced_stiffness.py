"""A stiffness with its published interval and source."""

from dataclasses import dataclass

import numpy as np

NEWTON_METRE_PER_DEGREE = 1e3 * 180.0 / np.pi
"""1 N m/° in N mm/rad."""


@dataclass(frozen=True)
class SourcedStiffness:
    """One stiffness of a joint.

    Attributes:
        name: of the motion.
        value: taken [N/mm or N mm/rad].
        low, high: published interval in the same unit.
        source: where it stands, and what was chosen.
    """

    name: str
    value: float
    low: float
    high: float
    source: str


def turning(name: str, value: float, low: float, high: float, source: str) -> SourcedStiffness:
    """A stiffness against turning, its figures in N m/°."""
    value, low, high = (NEWTON_METRE_PER_DEGREE * number for number in (value, low, high))
    return SourcedStiffness(name, value, low, high, source)
