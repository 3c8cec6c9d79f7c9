"""An order of poses in which every beginning covers them evenly: what to simulate first."""

from collections.abc import Sequence

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.dataset.protocol import Pose
from mixpinn.geometry.farthest_points import farthest_first as farthest_points_first

TURN = 20.0
"""A quarter turn of the probe counts like this distance between positions [mm]. Chosen by hand: two steps
of the protocol's grid of 10 mm."""


def farthest_first(poses: Sequence[Pose]) -> tuple[Pose, ...]:
    """The poses, each as far as possible from all before it; the first is the most central one.

    Distances are those between positions, a turn counting as `TURN` mm for 90°; a probe turned by 180° is the same.
    The order is that of `mixpinn.geometry.farthest_points`.
    """
    if not poses:
        return ()
    places = np.array([pose.position for pose in poses])
    angles = np.array([pose.rotation_deg for pose in poses])

    def distance(index: int) -> FloatArray:
        turn = np.abs(angles - angles[index]) % 180.0
        turn = np.minimum(turn, 180.0 - turn)
        squared: FloatArray = ((places - places[index]) ** 2).sum(axis=1) + (turn / 90.0 * TURN) ** 2
        return np.sqrt(squared)

    first = int(((places - places.mean(axis=0)) ** 2).sum(axis=1).argmin())
    return tuple(poses[index] for index in farthest_points_first(distance, first=first, count=len(poses)))
