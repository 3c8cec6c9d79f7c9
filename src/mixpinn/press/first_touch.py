"""First touch of a probe with the resting skin, compiled: how far beyond it a probe is, and which faces it may meet."""

import numba
import numpy as np

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@numba.njit(cache=True, nogil=True)
def _touch_depth(points, p, rotation, translation, underside, origin, spacing):  # type: ignore[no-untyped-def]
    """How far along the axis place p lies beyond the underside of a placed probe [mm]; −inf beside it."""
    x0 = points[p, 0] - translation[0]
    x1 = points[p, 1] - translation[1]
    x2 = points[p, 2] - translation[2]
    a = (rotation[0, 0] * x0 + rotation[1, 0] * x1 + rotation[2, 0] * x2 - origin[0]) / spacing
    b = (rotation[0, 2] * x0 + rotation[1, 2] * x1 + rotation[2, 2] * x2 - origin[2]) / spacing
    i, j = int(np.floor(a)), int(np.floor(b))
    if i < 0 or j < 0 or i >= underside.shape[0] - 1 or j >= underside.shape[1] - 1:
        return -np.inf
    a -= i
    b -= j
    low = (1.0 - a) * ((1.0 - b) * underside[i, j] + b * underside[i, j + 1])
    low += a * ((1.0 - b) * underside[i + 1, j] + b * underside[i + 1, j + 1])
    if not np.isfinite(low):
        return -np.inf
    return rotation[0, 1] * x0 + rotation[1, 1] * x1 + rotation[2, 1] * x2 - low


@numba.njit(cache=True, nogil=True)
def touch_depths(points, rotation, translation, underside, origin, spacing, depths):  # type: ignore[no-untyped-def]
    """How far along the axis each place lies beyond the underside of a placed probe [mm]; −inf beside it.

    Args:
        points: [mm], shape (p, 3).
        rotation, translation: of the probe.
        underside: see `ProbeField`, with the grid's origin and spacing.
        depths: filled, shape (p,).
    """
    for p in range(len(points)):
        depths[p] = _touch_depth(points, p, rotation, translation, underside, origin, spacing)


@numba.njit(cache=True, nogil=True)
def deepest_touch(  # type: ignore[no-untyped-def]
    points, starts, balls, rotation, translation, underside, origin, spacing,
):
    """The largest of `touch_depths`; faces beside the probe, and those farther back than another, are passed over.

    Args:
        points: in the order of the faces that they lie on [mm], shape (p, 3).
        starts: the first point of each face, and their number, shape (t + 1,).
        balls: centre and radius of a ball around the points of each face [mm], shape (t, 4).
        rotation, translation, underside, origin, spacing: as in `touch_depths`.
    """
    high0 = origin[0] + spacing * (underside.shape[0] - 1)
    high2 = origin[2] + spacing * (underside.shape[1] - 1)
    lowest, deepest = underside.min(), -np.inf
    for t in range(len(balls)):
        x0, x1, x2 = balls[t, 0] - translation[0], balls[t, 1] - translation[1], balls[t, 2] - translation[2]
        radius = balls[t, 3]
        if rotation[0, 1] * x0 + rotation[1, 1] * x1 + rotation[2, 1] * x2 + radius - lowest <= deepest:
            continue
        a = rotation[0, 0] * x0 + rotation[1, 0] * x1 + rotation[2, 0] * x2
        b = rotation[0, 2] * x0 + rotation[1, 2] * x1 + rotation[2, 2] * x2
        if a + radius < origin[0] or a - radius > high0 or b + radius < origin[2] or b - radius > high2:
            continue
        for p in range(starts[t], starts[t + 1]):
            deepest = max(deepest, _touch_depth(points, p, rotation, translation, underside, origin, spacing))
    return deepest


@numba.njit(cache=True, nogil=True)
def mark_shadow(points, starts, balls, rotation, translation, low, high, near):  # type: ignore[no-untyped-def]
    """Mark in `near` (t,) the faces of the points that lie between `low` and `high` along x and z of a placed probe.

    Args:
        points, starts, balls: of the faces, as in `deepest_touch`.
        rotation, translation: of the probe.
        low, high: [mm], shape (2,).
        near: flags.
    """
    for t in range(len(balls)):
        x0, x1, x2 = balls[t, 0] - translation[0], balls[t, 1] - translation[1], balls[t, 2] - translation[2]
        a = rotation[0, 0] * x0 + rotation[1, 0] * x1 + rotation[2, 0] * x2
        b = rotation[0, 2] * x0 + rotation[1, 2] * x1 + rotation[2, 2] * x2
        radius = balls[t, 3]
        if a + radius < low[0] or a - radius > high[0] or b + radius < low[1] or b - radius > high[1]:
            continue
        for p in range(starts[t], starts[t + 1]):
            x0, x1, x2 = points[p, 0] - translation[0], points[p, 1] - translation[1], points[p, 2] - translation[2]
            a = rotation[0, 0] * x0 + rotation[1, 0] * x1 + rotation[2, 0] * x2
            b = rotation[0, 2] * x0 + rotation[1, 2] * x1 + rotation[2, 2] * x2
            if low[0] <= a <= high[0] and low[1] <= b <= high[1]:
                near[t] = True
                break
