"""Contact along a path of placements, compiled: which points of the skin are near, and one solve after another."""

from typing import NamedTuple

import numba
import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.press.probe_field import FAR, LINEAR_ERROR, distance_about, distance_at
from mixpinn.press.step_kernel import STEEPEST, Contacts, field_of, solve_step

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.

_SLACK = 0.75
"""Points of the skin that would come this close to touching are followed during a step [mm]."""
_DEEP = 0.85
"""At first touch the points begin to push that the probe has come upon by more than this part of the deepest."""
_ON_THE_WAY = 5e-3
"""Tolerance of all steps but the last, which has its own. The nodes lie where the forces λ put them; what the law of
contact says there differs by this part, and with it the places by this part of the violations of the gap alone."""


class Skin(NamedTuple):
    """Points of the skin of a patch: nodes that each hangs on (p, w), how (p, w), and its stiffness [N/mm] (p,)."""

    stencil: IntArray
    weights: FloatArray
    stiffness: FloatArray


class Path(NamedTuple):
    """Placements of k probes before the first of s steps and after each.

    Attributes:
        rotations, translations: of the probes, shapes (s + 1, k, 3, 3) and (s + 1, k, 3).
        shifts: where the nodes would be without contact, relative to rest, at the same times, shape (s + 1, n, 3).
    """

    rotations: FloatArray
    translations: FloatArray
    shifts: FloatArray


@numba.njit(cache=True, nogil=True)
def follow(  # type: ignore[no-untyped-def]
    rest, compliance, skin, fields, path, force, slip, push, leads, law, tolerance, max_iterations,
):
    """Go along a path of placements, each step from the equilibrium of the one before.

    Args:
        rest: nodes of the patch [mm], shape (n, 3).
        compliance: of the patch [mm/N], shape (3 n, 3 n).
        skin: a `Skin`.
        fields: of the probes, joined (see `field_of`).
        path: a `Path`.
        force, slip, push: λ (3 n,), elastic slips in the probes' frames (k, p, 3) and normal forces (k, p) before the
            first step; normal forces only help to find those after it.
        leads: v₀ of every point under every probe, shape (k, p).
        law: gap, μ, δ.
        tolerance: of the forces after the last step, relative.
        max_iterations: of one solve.

    Returns:
        λ, slips, normal forces (k, p), forces in the world (k, p, 3), steps done, iterations. It ends early where a
        step finds no equilibrium.
    """
    n_steps, n_probes = path.rotations.shape[0] - 1, path.rotations.shape[1]
    n, n_points = len(rest), len(skin.stencil)
    force, slip, push = force.copy(), slip.copy(), push.copy()
    earlier, had_earlier, before_length = force.copy(), False, 0.0
    pull = np.zeros((n_probes, n_points, 3))
    ahead, places = np.empty((n_probes, n_points)), np.empty((n_probes, n_points, 3))
    rooms, where = np.zeros((2, n_probes, n_points)), np.zeros((2, n_probes, n, 3))
    spread = _spread(skin.weights)
    chosen = np.empty((n_probes, n_points), np.bool_)
    used = 0
    local = np.full(n, -1)
    for step in range(n_steps):
        x = _positions(rest, path.shifts[step], compliance, force)
        length = _look_ahead(x, skin, spread, fields, path, step, law[0], slip, ahead, places, rooms, where)
        slack, done, last, guess = _SLACK, False, step == n_steps - 1, 0
        for _ in range(4):
            pairs = _followed(ahead, slip, slack, chosen)
            if not len(pairs):
                force[:] = 0.0
                push[:], pull[:] = 0.0, 0.0
                done = True
                break
            nodes = _nodes_of(pairs, skin.stencil, local)
            # The first guess goes on as the last step went, the next stays at its forces. None begins without forces:
            # skin that was deep in the probe would come out of it wherever it is nearest.
            ratio = length / before_length if had_earlier and before_length > 0.0 and guess == 0 else 0.0
            part, near, lift, begin = _restrict(nodes, rest, compliance, path, step, force, earlier, ratio, guess)
            contacts = _contacts(pairs, local, skin, fields, path, step, x, slip, leads, law)
            found, forces, converged, iterations = solve_step(
                near, lift, part, begin, contacts, _first(pairs, push, ahead), _clear(pairs, ahead, places),
                tolerance if last else max(tolerance, _ON_THE_WAY), max_iterations,
            )
            used += iterations
            if not converged or _inside(pairs, contacts, forces.push):
                guess += 1
                if guess == 2 or (ratio == 0.0 and not lift.any()):
                    break  # each was tried once; with nothing to go on with the two are one
                continue
            answer = np.zeros(3 * n)
            for i in range(len(nodes)):
                for r in range(3):
                    answer[3 * nodes[i] + r] = forces.gradient[i, r] if last else found[3 * i + r]
            # Skin that nothing followed must not have come under the probe; on the way the next step will see it.
            if last and _beside(_positions(rest, path.shifts[step + 1], compliance, answer), skin, fields, path, step,
                                law[0], chosen):
                slack *= 4.0
                rooms[:] = 0.0
                _look_ahead(x, skin, spread, fields, path, step, law[0], slip, ahead, places, rooms, where)
                continue
            earlier[:] = force
            force[:] = answer
            slip[:] = 0.0
            push[:], pull[:] = 0.0, 0.0
            for c in range(len(pairs)):
                k, p = pairs[c, 0], pairs[c, 1]
                push[k, p] = forces.push[c]
                for r in range(3):
                    slip[k, p, r], pull[k, p, r] = forces.slip[c, r], forces.pull[c, r]
            done = True
            break
        if not done:
            return force, slip, push, pull, step, used
        had_earlier = True
        before_length = length
    return force, slip, push, pull, n_steps, used


@numba.njit(cache=True, nogil=True)
def _inside(pairs, contacts, push):  # type: ignore[no-untyped-def]
    """Whether skin lies in a probe: farther than the gap beyond it, where forces point to wherever it is nearest."""
    gap, _, delta = contacts.law
    for c in range(len(pairs)):
        if push[c] > contacts.stiffness[pairs[c, 1]] * (gap + contacts.lead[c] - 0.5 * delta):
            return True
    return False


@numba.njit(cache=True, nogil=True)
def _spread(weights):  # type: ignore[no-untyped-def]
    """A point moves at most this many times as far as the node that moves farthest."""
    most = 1.0
    for p in range(len(weights)):
        total = 0.0
        for i in range(weights.shape[1]):
            total += abs(weights[p, i])
        most = max(most, total)
    return most


@numba.njit(cache=True, nogil=True)
def _look_ahead(  # type: ignore[no-untyped-def]
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
def _clear(pairs, ahead, places):  # type: ignore[no-untyped-def]
    """Where the points of `pairs` lie after the step and how far they are from the gap there at least, (c, 4)."""
    found = np.zeros((len(pairs), 4))
    for c in range(len(pairs)):
        k, p = pairs[c, 0], pairs[c, 1]
        for r in range(3):
            found[c, r] = places[k, p, r]
        if ahead[k, p] > -0.5 * FAR:  # off the grid of distances nothing is known
            found[c, 3] = max(0.0, -ahead[k, p])
    return found


@numba.njit(cache=True, nogil=True)
def _first(pairs, push, ahead):  # type: ignore[no-untyped-def]
    """Which of `pairs` are pushed before the step, flags (c,); where none is, those that the probe comes deepest on."""
    found, any_pushed, deepest = np.zeros(len(pairs), np.bool_), False, 0.0
    for c in range(len(pairs)):
        k, p = pairs[c, 0], pairs[c, 1]
        found[c], deepest = push[k, p] > 0.0, max(deepest, ahead[k, p])
        any_pushed = any_pushed or found[c]
    if not any_pushed:
        for c in range(len(pairs)):
            found[c] = ahead[pairs[c, 0], pairs[c, 1]] > _DEEP * deepest
    return found


@numba.njit(cache=True, nogil=True)
def _followed(violation, slip, slack, chosen):  # type: ignore[no-untyped-def]
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
def _nodes_of(pairs, stencil, local):  # type: ignore[no-untyped-def]
    """Nodes that the points of `pairs` hang on, ascending; fills `local` (n,) with their number here, else −1."""
    local[:] = -1
    for c in range(len(pairs)):
        for i in range(stencil.shape[1]):
            local[stencil[pairs[c, 1], i]] = 0
    nodes = np.flatnonzero(local >= 0)
    for i in range(len(nodes)):
        local[nodes[i]] = i
    return nodes


@numba.njit(cache=True, nogil=True)
def _restrict(  # type: ignore[no-untyped-def]
    nodes, rest, compliance, path, step, force, earlier, ratio, guess,
):
    """Compliance, free places, lift and first guess of some nodes: what `solve_step` takes."""
    shifts, a = path.shifts, len(nodes)
    part, near, lift, begin = np.empty((3 * a, 3 * a)), np.empty((a, 3)), np.zeros((a, 3)), np.empty(3 * a)
    for i in range(a):
        for r in range(3):
            near[i, r] = rest[nodes[i], r] + shifts[step + 1, nodes[i], r]
            if guess == 0:
                lift[i, r] = shifts[step + 1, nodes[i], r] - shifts[step, nodes[i], r]
            here = 3 * nodes[i] + r
            begin[3 * i + r] = force[here] + ratio * (force[here] - earlier[here])
            row, source = part[3 * i + r], compliance[here]
            for j in range(a):
                for q in range(3):
                    row[3 * j + q] = source[3 * nodes[j] + q]
    return part, near, lift, begin


@numba.njit(cache=True, nogil=True)
def _contacts(pairs, local, skin, fields, path, step, x, slip, leads, law):  # type: ignore[no-untyped-def]
    """The `Contacts` of `pairs` after a step from node positions x, their stencil by the numbers in `local`."""
    count, width, points, shares = len(pairs), skin.stencil.shape[1], skin.stencil, skin.weights
    stencil, weights = np.empty((count, width), np.int64), np.empty((count, width))
    before, carried, lead = np.zeros((count, 3)), np.empty((count, 3)), np.empty(count)
    placed, probe = np.empty((len(x), 3)), -1
    for c in range(count):
        k, p = pairs[c, 0], pairs[c, 1]
        if k != probe:
            _place_nodes(x, local, path.rotations[step, k], path.translations[step, k], placed)
            probe = k
        lead[c] = leads[k, p]
        for i in range(width):
            node, w = points[p, i], shares[p, i]
            stencil[c, i], weights[c, i] = local[node], w
            for r in range(3):
                before[c, r] += w * placed[node, r]
        for r in range(3):
            carried[c, r] = slip[k, p, r]
    return Contacts(
        pairs, stencil, weights, skin.stiffness, fields, path.rotations[step + 1], path.translations[step + 1], before,
        carried, lead, law,
    )


@numba.njit(cache=True, nogil=True)
def _place_nodes(x, local, rotation, translation, placed):  # type: ignore[no-untyped-def]
    """Fills `placed` (n, 3) with the nodes that have a number in `local`, in the frame of a probe."""
    for i in range(len(x)):
        if local[i] >= 0:
            x0, x1, x2 = x[i, 0] - translation[0], x[i, 1] - translation[1], x[i, 2] - translation[2]
            for r in range(3):
                placed[i, r] = rotation[0, r] * x0 + rotation[1, r] * x1 + rotation[2, r] * x2


@numba.njit(cache=True, nogil=True)
def _beside(x, skin, fields, path, step, gap, chosen):  # type: ignore[no-untyped-def]
    """Whether after a step a point that was not `chosen` violates the gap under a probe."""
    for k in range(len(chosen)):
        field, box = field_of(fields, k), (fields[5][k], fields[6][k])
        if _touches(x, skin.stencil, skin.weights, field, box, path.rotations[step + 1, k],
                    path.translations[step + 1, k], gap, chosen[k]):
            return True
    return False


@numba.njit(cache=True, nogil=True, fastmath=True)
def _positions(rest, shift, compliance, force):  # type: ignore[no-untyped-def]
    """Nodes under forces: rest + shift − W λ, (n, 3)."""
    n = len(rest)
    x = rest + shift
    loaded = np.flatnonzero(force)
    for i in range(n):
        for r in range(3):
            row, total = compliance[3 * i + r], 0.0
            for j in range(len(loaded)):
                total += row[loaded[j]] * force[loaded[j]]
            x[i, r] -= total
    return x


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
    reach, unsure = gap + 4.0 * _SLACK, LINEAR_ERROR * spacing
    near, farthest = -_SLACK - 2.0 * unsure, 0.0
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
