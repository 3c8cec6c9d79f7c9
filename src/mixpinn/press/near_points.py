"""Which points of the skin a step along a path follows, compiled: those that may touch a probe during it."""

import numba
import numpy as np

from mixpinn.press.probe_field import FAR, LINEAR_ERROR, distance_about, distance_at
from mixpinn.press.step_kernel import STEEPEST, field_of

SLACK = 0.75
"""Points of the skin that would come this close to touching are followed during a step [mm]."""

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@numba.njit(cache=True, nogil=True)
def largest_weight(weights):  # type: ignore[no-untyped-def]
    """A point moves at most this many times as far as the node that moves farthest."""
    most = 1.0
    for p in range(len(weights)):
        total = 0.0
        for i in range(weights.shape[1]):
            total += abs(weights[p, i])
        most = max(most, total)
    return most


@numba.njit(cache=True, nogil=True)
def look_ahead(  # type: ignore[no-untyped-def]
    x, skin, spread, fields, path, step, gap, slip, ahead, places, rooms, where,
):
    """By how much each point may violate the gap after a step, at worst before or after the nodes shift (`ahead`), and
    where it lies in the frame of the probe then (`places`); returns the longest way of a probe.

    For both, `rooms`, (2, k, p), tells how far each point may still move before it matters, and `where`, (2, k, n, 3),
    where the nodes were.
    """
    shifts, length = path.shifts, 0.0
    shifting = (shifts[step + 1] != shifts[step]).any()
    raised = x + shifts[step + 1] - shifts[step] if shifting else x
    other, elsewhere = np.empty(ahead.shape[1]), np.empty((ahead.shape[1], 3))
    for k in range(len(ahead)):
        rotation, translation = path.rotations[step + 1, k], path.translations[step + 1, k]
        field, box = field_of(fields, k), (fields[5][k], fields[6][k])
        _approach(
            raised, skin, spread, field, box, rotation, translation, gap, slip[k], ahead[k], places[k], rooms[0, k],
            where[0, k],
        )
        if shifting:
            _approach(
                x, skin, spread, field, box, rotation, translation, gap, slip[k], other, elsewhere, rooms[1, k],
                where[1, k],
            )
            ahead[k] = np.maximum(ahead[k], other)
        moved = translation - path.translations[step, k]
        length = max(length, np.sqrt((moved * moved).sum()))
    return length


@numba.njit(cache=True, nogil=True)
def followed_points(violation, slip, slack, chosen):  # type: ignore[no-untyped-def]
    """Points that a step follows: near to touching, or sticking before it; fills flags (k, p), and returns (c, 2)."""
    count = 0
    for k in range(len(chosen)):
        for p in range(chosen.shape[1]):
            chosen[k, p] = violation[k, p] > -slack or (
                slip[k, p, 0] != 0.0 or slip[k, p, 1] != 0.0 or slip[k, p, 2] != 0.0
            )
            count += chosen[k, p]
    pairs, c = np.empty((count, 2), np.int64), 0
    for k in range(len(chosen)):
        for p in range(chosen.shape[1]):
            if chosen[k, p]:
                pairs[c, 0], pairs[c, 1] = k, p
                c += 1
    return pairs


@numba.njit(cache=True, nogil=True)
def missed_points(x, skin, fields, path, step, gap, chosen):  # type: ignore[no-untyped-def]
    """Whether after a step a point that was not `chosen` violates the gap under a probe."""
    for k in range(len(chosen)):
        field, box = field_of(fields, k), (fields[5][k], fields[6][k])
        if _touches(x, skin.stencil, skin.weights, field, box, path.rotations[step + 1, k],
                    path.translations[step + 1, k], gap, chosen[k]):
            return True
    return False


@numba.njit(cache=True, nogil=True)
def _in_frame(x, stencil, weights, p, rotation, translation, place):  # type: ignore[no-untyped-def]
    """Fills `place` with point p in the probe's frame."""
    x0, x1, x2 = -translation[0], -translation[1], -translation[2]
    for i in range(stencil.shape[1]):
        w, node = weights[p, i], stencil[p, i]
        x0 += w * x[node, 0]
        x1 += w * x[node, 1]
        x2 += w * x[node, 2]
    for r in range(3):
        place[r] = rotation[0, r] * x0 + rotation[1, r] * x1 + rotation[2, r] * x2


@numba.njit(cache=True, nogil=True)
def _beyond(x0, x1, x2, box):  # type: ignore[no-untyped-def]
    """How far a place lies beyond a box at least; negative inside."""
    low, high = box
    away = max(low[0] - x0, x0 - high[0])
    away = max(away, max(low[1] - x1, x1 - high[1]))
    return max(away, max(low[2] - x2, x2 - high[2]))


@numba.njit(cache=True, nogil=True)
def _approach(  # type: ignore[no-untyped-def]
    x, skin, spread, field, box, rotation, translation, gap, slip, violation, places, room, where,
):
    """Points in the frame of a probe, and by how much they violate the gap there at most.

    `box` bounds the probe; points farther from it than matters are passed over, and so are those that have `room` left,
    (p,), for what the nodes have moved from where they were, (n, 3), and that do not stick.
    """
    coefficients, shape, origin, spacing = field
    stencil, weights = skin.stencil, skin.weights
    reach, unsure = gap + 4.0 * SLACK, LINEAR_ERROR * spacing
    near, farthest = -SLACK - 2.0 * unsure, 0.0
    for i in range(len(x)):
        x0, x1, x2 = x[i, 0] - translation[0], x[i, 1] - translation[1], x[i, 2] - translation[2]
        way = 0.0
        for r in range(3):
            at = rotation[0, r] * x0 + rotation[1, r] * x1 + rotation[2, r] * x2
            way += (at - where[i, r]) ** 2
            where[i, r] = at
        farthest = max(farthest, way)
    farthest = spread * np.sqrt(farthest)
    place = np.empty(3)
    for p in range(len(stencil)):
        room[p] -= farthest
        violation[p] = -FAR
        if room[p] > 0.0 and slip[p, 0] == 0.0 and slip[p, 1] == 0.0 and slip[p, 2] == 0.0:
            continue
        x0, x1, x2 = 0.0, 0.0, 0.0
        for i in range(stencil.shape[1]):
            w, node = weights[p, i], stencil[p, i]
            x0 += w * where[node, 0]
            x1 += w * where[node, 1]
            x2 += w * where[node, 2]
        places[p, 0], places[p, 1], places[p, 2] = x0, x1, x2
        away = _beyond(x0, x1, x2, box)
        if away > reach:
            room[p] = away - gap + near
            continue
        place[0], place[1], place[2] = x0, x1, x2
        violation[p] = gap + unsure - distance_about(coefficients, shape, origin, spacing, place)
        if violation[p] > -0.5 * FAR:
            room[p] = (near - violation[p]) / STEEPEST
        else:
            room[p] = 0.0  # off the grid nothing is known


@numba.njit(cache=True, nogil=True)
def _touches(x, stencil, weights, field, box, rotation, translation, gap, known):  # type: ignore[no-untyped-def]
    """Whether a point that is not `known` violates the gap."""
    coefficients, shape, origin, spacing = field
    place, gradient, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    unsure = LINEAR_ERROR * spacing
    for p in range(len(stencil)):
        if not known[p]:
            _in_frame(x, stencil, weights, p, rotation, translation, place)
            if _beyond(place[0], place[1], place[2], box) > gap:
                continue
            if distance_about(coefficients, shape, origin, spacing, place) - unsure >= gap:
                continue
            if distance_at(coefficients, shape, origin, spacing, place, gradient, bend) < gap:
                return True
    return False
