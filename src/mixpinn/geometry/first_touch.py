"""First touch: where the tip stands when a probe that comes straight along its axis meets a surface."""

from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.records import Probe

if TYPE_CHECKING:
    import pyvista as pv


def first_touch(
    position: FloatArray, rotation: FloatArray, *, points: FloatArray, triangles: IntArray, probe: Probe,
    gap: float, tolerance: float = 1e-3,
) -> FloatArray:
    """Where the tip stands when the probe, coming along its own −y from far away, first is `gap` from the surface.

    Conservative advancement (Mirtich 1996): the probe is as far from the skin as the nearest vertex of either is
    from the other's surface, D; moving it by D − gap cannot carry it past first touch, so the sum of such moves
    converges to it from outside. Edges that cross without a vertex near them are not seen.

    Args:
        position: a point on the line along which the tip moves [mm], shape (3,).
        rotation: rotation matrix of the probe, shape (3, 3); it presses along ``rotation @ (0, −1, 0)``.
        points: vertices of the surface that is touched [mm], shape (p, 3).
        triangles: of the surface, shape (t, 3).
        probe: the probe's surface.
        gap: distance at which contact acts [mm].
        tolerance: distance from `gap` at which the search ends [mm].

    Returns:
        The tip [mm], shape (3,).

    Raises:
        InputError: no skin lies in the probe's way.
    """
    import pyvista as pv

    direction, axes = rotation @ PROBE_AXIS, rotation[:, [0, 2]].T
    tool = probe.points @ rotation.T
    reach = np.linalg.norm(tool @ axes.T, axis=1).max() + gap
    corners = (points[triangles] - position) @ axes.T
    centres = corners.mean(axis=1)
    size = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    near = triangles[np.linalg.norm(centres, axis=1) - size < reach + 2.0 * gap]
    if not len(near):
        raise _missed(position, "none")
    used, local = np.unique(near, return_inverse=True)
    skin = pv.PolyData.from_regular_faces(points[used], local.reshape(-1, 3))
    surface = pv.PolyData.from_regular_faces(tool, probe.triangles)
    nodes = np.asarray(skin.points)
    ahead = float((nodes @ direction).min()) - float((tool @ direction).max()) - gap - 1.0
    travel = ahead - float(position @ direction)
    limit = travel + float(np.ptp(nodes @ direction) + np.ptp(tool @ direction)) + 4.0 * gap + 2.0
    while travel < limit:
        offset: FloatArray = position + travel * direction
        distance = min(_distance(tool + offset, skin), _distance(nodes - offset, surface))
        if distance - gap < tolerance:
            return offset
        travel += distance - gap
    raise _missed(position, "a way that misses it")


def _missed(position: FloatArray, got: str) -> InputError:
    return InputError(
        f"probe position {np.round(position, 1).tolist()}", expected="skin in the probe's way", got=got,
        fix="move the position over the body",
    )


def _distance(points: FloatArray, surface: "pv.PolyData") -> float:
    _, closest = surface.find_closest_cell(points, return_closest_point=True)
    return float(np.sqrt(((points - closest) ** 2).sum(axis=1).min()))
