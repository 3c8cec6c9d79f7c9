"""Contact along a path of placements, compiled: one solve after another (`step_kernel`), each of the points near by."""

from typing import NamedTuple

import numba
import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.physics.elimination import symmetric_times
from mixpinn.press.near_points import SLACK, followed_points, largest_weight, look_ahead, missed_points
from mixpinn.press.probe_field import FAR
from mixpinn.press.step_kernel import Contacts, solve_step

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.

_DEEP = 0.85
"""At first touch the points begin to push that the probe has come upon by more than this part of the deepest."""


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
    rest, compliance, skin, fields, path, force, slip, push, leads, law, tolerances, limits,
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
        tolerances: of the forces, relative, after the last step and after all others. The nodes lie where the forces λ
            put them; what the law of contact says there differs by this part, and with it the places by this part of
            the violations of the gap alone.
        limits: the most iterations from one guess, and the most tries of all steps; see `solve_step`.

    Returns:
        λ, slips, normal forces (k, p), forces in the world (k, p, 3), steps done, tries. It ends early where a step
        finds no equilibrium, or after too many tries.
    """
    n_steps, n_probes = path.rotations.shape[0] - 1, path.rotations.shape[1]
    n, n_points = len(rest), len(skin.stencil)
    force, slip, push = force.copy(), slip.copy(), push.copy()
    earlier, had_earlier, before_length = force.copy(), False, 0.0
    pull = np.zeros((n_probes, n_points, 3))
    ahead, places = np.empty((n_probes, n_points)), np.empty((n_probes, n_points, 3))
    rooms, where = np.zeros((2, n_probes, n_points)), np.zeros((2, n_probes, n, 3))
    spread = largest_weight(skin.weights)
    chosen = np.empty((n_probes, n_points), np.bool_)
    used = 0
    local = np.full(n, -1)
    for step in range(n_steps):
        x = _positions(rest, path.shifts[step], compliance, force)
        length = look_ahead(x, skin, spread, fields, path, step, law[0], slip, ahead, places, rooms, where)
        slack, done, last, guess = SLACK, False, step == n_steps - 1, 0
        for _ in range(4):
            pairs = followed_points(ahead, slip, slack, chosen)
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
            found, forces, converged, taken = solve_step(
                near, lift, part, begin, contacts, _first(pairs, push, ahead), _clear(pairs, ahead, places),
                tolerances[0] if last else max(tolerances[0], tolerances[1]),
                (limits[0], limits[1] - used),
            )
            used += taken
            if used >= limits[1]:
                break
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
            if last and missed_points(
                _positions(rest, path.shifts[step + 1], compliance, answer), skin, fields, path, step, law[0], chosen,
            ):
                slack *= 4.0
                rooms[:] = 0.0
                look_ahead(x, skin, spread, fields, path, step, law[0], slip, ahead, places, rooms, where)
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
def _positions(rest, shift, compliance, force):  # type: ignore[no-untyped-def]
    """Nodes under forces: rest + shift − W λ, (n, 3)."""
    moved = np.empty(len(force))
    symmetric_times(compliance, force, moved)
    return rest + shift - moved.reshape(len(rest), 3)
