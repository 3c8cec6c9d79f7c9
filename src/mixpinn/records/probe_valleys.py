"""Edges of a probe: valleys that skin may lie against, and sharp ridges.

In a valley the nearest place of the probe jumps from one side to the other, and with it the direction of contact, by
the angle between the two faces. Contact that sits there may have no equilibrium at all: on either side, it is pushed
to the other.
"""

from typing import NamedTuple

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray

SHALLOW = 2.0
"""Valleys up to this deep are as good as flat [degree]: a curved face that was cut into triangles may have them."""
_HIGH = 20.0
"""Edges farther above the tip than a probe is pressed into the skin are not met [mm]."""
_UP = 0.3
"""Faces whose unit normal has more than this along y look away from the skin."""


class Turns(NamedTuple):
    """How the surface turns at each edge of two faces.

    Attributes:
        angle: between the faces [degree], shape (e,).
        concave: whether it turns towards its outer side, shape (e,).
        height: of the edge's upper end [mm], shape (e,).
        facing: y of the unit normal of the face that looks down more, shape (e,).
    """

    angle: FloatArray
    concave: BoolArray
    height: FloatArray
    facing: FloatArray


def turns(points: FloatArray, triangles: IntArray) -> Turns:
    """How the surface of a probe turns at its edges.

    Args:
        points: vertices of the probe, which points to −y [mm], shape (p, 3).
        triangles: that face alike, shape (t, 3).
    """
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1)
    triangles, normals = triangles[size > 0.0], normals[size > 0.0] / size[size > 0.0, None]
    if _faces_inward(points, triangles, normals):
        normals = -normals
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    apex, owner = np.roll(triangles, -2, axis=1).ravel(), np.repeat(np.arange(len(triangles)), 3)
    forth, back = start * len(points) + end, end * len(points) + start
    order = np.argsort(forth)
    place = np.minimum(np.searchsorted(forth, back, sorter=order), len(order) - 1)
    twin = order[place]
    once = (forth[twin] == back) & (start < end)
    first, second, other = owner[once], owner[twin[once]], apex[twin[once]]
    start, end = start[once], end[once]
    rise = np.einsum("ek,ek->e", normals[first], points[other] - points[start])
    angle = np.rad2deg(np.arccos(np.clip(np.einsum("ek,ek->e", normals[first], normals[second]), -1.0, 1.0)))
    height = np.maximum(points[start, 1], points[end, 1])
    return Turns(angle, rise > 0.0, height, np.minimum(normals[first, 1], normals[second, 1]))


def valleys(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Angles between the faces at the concave edges that may touch skin [degree], largest first, shape (e,).

    Args:
        points: vertices of the probe, which points to −y [mm], shape (p, 3).
        triangles: that face alike, shape (t, 3).
    """
    at = turns(points, triangles)
    met = (at.height <= points[:, 1].min() + _HIGH) & (at.facing < _UP)
    found: FloatArray = np.sort(at.angle[at.concave & met & (at.angle > SHALLOW)])[::-1]
    return found


def valley_warning(points: FloatArray, triangles: IntArray) -> str:
    """What a user should know of the valleys of a probe, in one line; empty where there are none."""
    found = valleys(points, triangles)
    if not len(found):
        return ""
    number = "a valley" if len(found) == 1 else f"{len(found)} valleys"
    return (
        f"the probe has {number} between its faces, up to {found[0]:.0f}° deep: where skin lies in one, the direction "
        "of contact jumps, and a step may find no equilibrium; fill them (the convex hull of the probe has none)"
    )


def _faces_inward(points: FloatArray, triangles: IntArray, normals: FloatArray) -> bool:
    """Whether the triangles around the tip look up, into the probe."""
    height = points[triangles, 1].mean(axis=1)
    return bool(normals[height <= height.min() + 1.0, 1].mean() > 0.0)
