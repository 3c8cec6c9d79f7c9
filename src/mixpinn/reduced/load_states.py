"""Random contacts of a probe's footprint on the linear body: loads that modes of the prior's responses are drawn from.

No simulation is needed. A state is a flat rectangle of random place, turn, tilt and size that stands some way inside
the skin: the contact nodes under it are brought into its plane and drawn along by a random share of the way, and forces
that would pull are released. Such loads grow towards the rim of the footprint, as those of real contact do; smooth
pressures do not.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from mixpinn.base.arrays import Float32Array, FloatArray

_RELEASES = 3
"""How often pulling nodes are let go; what still pulls then stays, since only the span of the loads matters."""


@dataclass(frozen=True)
class Footprints:
    """How contacts are drawn.

    Attributes:
        length: smallest and largest half-length of a footprint along its long side [mm].
        width: the same across it [mm].
        depth: smallest and largest depth below the highest node under it [mm].
        tilt: largest slope of the plane along either side.
        drag: largest way along the skin, relative to the way into it.
        seed: of the draw.

    The lengths are those of ultrasound probes, from partial to full contact, and the depths those of the protocols;
    they were chosen by hand.
    """

    length: tuple[float, float] = (8.0, 30.0)
    width: tuple[float, float] = (4.0, 10.0)
    depth: tuple[float, float] = (0.5, 20.0)
    tilt: float = 0.15
    drag: float = 0.3
    seed: int = 0


def draw_loads(
    points: FloatArray, own: FloatArray, count: int, footprints: Footprints | None = None,
) -> Float32Array:
    """Forces on contact nodes [N], float32, shape (count, 3 c).

    Args:
        points: rest positions of the contact nodes [mm], shape (c, 3); the probe presses along −y.
        own: their own compliance [mm/N], shape (3 c, 3 c).
        count: number of contacts.
        footprints: how they are drawn.
    """
    shapes = footprints or Footprints()
    rng = np.random.default_rng(shapes.seed)
    loads = np.zeros((count, *points.shape))
    for load in loads:
        centre = points[rng.integers(len(points))] + rng.uniform(-5.0, 5.0, 3)
        turn, long, wide = rng.uniform(0.0, np.pi), rng.uniform(*shapes.length), rng.uniform(*shapes.width)
        x, z = (points - centre)[:, [0, 2]].T
        along, across = x * np.cos(turn) + z * np.sin(turn), z * np.cos(turn) - x * np.sin(turn)
        under = (np.abs(along) < long) & (np.abs(across) < wide)
        under[np.hypot(x, z).argmin()] = True
        slope, drag = rng.uniform(-shapes.tilt, shapes.tilt, 2), rng.uniform(-shapes.drag, shapes.drag, 2)
        depth = points[under, 1].max() - rng.uniform(*shapes.depth) + slope[0] * along + slope[1] * across
        way = points[:, 1] - depth
        move = way[:, None] * np.array([drag[0], -1.0, drag[1]])
        held = np.flatnonzero(under & (way > 0.0))
        if not len(held):
            held = np.flatnonzero(under)[:1]
        for _ in range(_RELEASES):
            rows = (3 * held[:, None] + np.arange(3)).ravel()
            force = scipy.linalg.solve(own[np.ix_(rows, rows)], move[held].ravel(), assume_a="pos").reshape(-1, 3)
            load[:] = 0.0
            load[held] = force
            pushes = force[:, 1] < 0.0
            if pushes.all() or not pushes.any():
                break
            held = held[pushes]
    return loads.reshape(count, points.size).astype(np.float32)
