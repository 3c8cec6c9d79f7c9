"""Equilibrium of contact with the linear body at one placement of the probes, compiled.

A contact is a point of the skin under one probe. In the probe's frame the point lies at p, the distance there is d(p)
with the unit normal n. The law (`mixpinn.physics.contact_law`) takes the violation v = g − d + v₀ and the elastic slip
s₀ + p − p₀ across n, with one stiffness k for both; p₀ is where the point lay and s₀ the slip that it carried at the
beginning of the step. v₀ is zero, or the violation N / k of an earlier solve: then the gap is kept although k is
moderate (the multiplier of an augmented Lagrangian).

The linear body answers forces λ on its nodes with y = free − W λ. Equilibrium λ = g(y), g the gradient of contact by
the nodes, is sought among the nodes near the probe by Newton's method (`mixpinn.press.newton_direction`), each step
shortened until (g − λ)ᵀ W (g − λ) falls. No library of linear algebra takes part: nothing waits for threads.
"""

from typing import Any, NamedTuple

import numba
import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.physics.contact_law import penalty, return_slip, slip_derivative
from mixpinn.physics.elimination import symmetric_times
from mixpinn.press.newton_direction import newton_direction, resistance
from mixpinn.press.probe_field import FAR, distance_at

STEEPEST = 1.3
"""The splines of distances outside probes change by less than this many times the way; 1.27 was seen."""

_LARGEST_MOVE = 2.0
"""No node moves farther than this in one iteration [mm]: skin does not pass through a probe."""
_STUCK, _GAIN = 4, 0.005
"""A search that gains less than this part of its error so many times in a row is at a kink that it does not leave."""

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


class Contacts(NamedTuple):
    """Points of the skin under probes, c of them, at one placement of the probes.

    Attributes:
        pairs: probe and point of each, shape (c, 2).
        stencil, weights: nodes that a point hangs on, and how, shapes (c, w).
        stiffness: of all points of the skin [N/mm].
        fields: distances from the probes, see `field_of`.
        rotations, translations: of the probes.
        before, carried: p₀ and s₀ of each contact, shapes (c, 3).
        lead: v₀ of each contact, shape (c,).
        law: gap, μ, δ.
    """

    pairs: IntArray
    stencil: IntArray
    weights: FloatArray
    stiffness: FloatArray
    fields: Any
    rotations: FloatArray
    translations: FloatArray
    before: FloatArray
    carried: FloatArray
    lead: FloatArray
    law: tuple[float, float, float]


class Forces(NamedTuple):
    """What contacts exert on n nodes.

    Attributes:
        gradient: by the nodes, shape (n, 3).
        slope: stiffness of each point, −∂force/∂place in the world, shape (c, 3, 3), filled where it is pushed.
        push: normal force of each contact, shape (c,).
        slip: elastic slip of each in the probe's frame, shape (c, 3).
        pull: force on each point in the world, shape (c, 3).
        seen: where each point was and how far from the gap, shape (c, 4): while it has not moved as far as that, there
            is nothing to ask.
    """

    gradient: FloatArray
    slope: FloatArray
    push: FloatArray
    slip: FloatArray
    pull: FloatArray
    seen: FloatArray


@numba.njit(cache=True, nogil=True)
def field_of(fields, k):  # type: ignore[no-untyped-def]
    """Coefficients, shape, origin and spacing of the distance from probe k; `fields` holds them for all of them."""
    flat, starts, shapes, origins, spacings = fields[0], fields[1], fields[2], fields[3], fields[4]
    return flat[starts[k] : starts[k + 1]], shapes[k], origins[k], spacings[k]


@numba.njit(cache=True, nogil=True)
def point_force(  # type: ignore[no-untyped-def]
    place, before, carried, lead, stiffness, law, field, normal, force, slip, slope, room,
):
    """Force on one point in the probe's frame, its elastic slip, and −∂force/∂place, exact.

    Returns N, or the violation where it is negative and known: off the grid of distances 0.

    `law` holds gap, μ and δ; `field` the coefficients, shape, origin and spacing of a `ProbeField`; `room`, two
    vectors and two matrices, is to work in. Without contact nothing but the slip, zero, is filled.
    """
    across, leaning, bend, turn = room
    coefficients, shape, origin, spacing = field
    gap, friction, delta = law
    distance = distance_at(coefficients, shape, origin, spacing, place, normal, bend)
    violation = gap - distance + lead
    slip[0], slip[1], slip[2] = 0.0, 0.0, 0.0
    if distance >= FAR:
        return 0.0
    if violation <= 0.0:
        return violation
    size = np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
    if size < 1e-6:
        return 0.0
    for r in range(3):
        normal[r] /= size
    _, push, rise = penalty(violation, stiffness, delta)
    # How the normal turns when the place moves: (1 − n nᵀ) ∇∇d / |∇d|.
    for c in range(3):
        along = (normal[0] * bend[0, c] + normal[1] * bend[1, c] + normal[2] * bend[2, c]) / size
        for r in range(3):
            turn[r, c] = bend[r, c] / size - normal[r] * along
    away = 0.0
    for r in range(3):
        slip[r] = carried[r] + place[r] - before[r]
        away += slip[r] * normal[r]
    for c in range(3):  # n · (the way) when the normal turns
        leaning[c] = slip[0] * turn[0, c] + slip[1] * turn[1, c] + slip[2] * turn[2, c]
    hold, sticks, _ = return_slip(slip, normal, friction * push, stiffness, across)
    for c in range(3):
        turned = 0.0
        for r in range(3):
            turned += across[r] * turn[r, c]
        for r in range(3):
            slope[r, c] = rise * size * normal[r] * normal[c] - push * turn[r, c]
            # ∂T/∂e of the slip e = (1 − n nᵀ) (s₀ + p − p₀), and what the turning normal does to e.
            slope[r, c] += hold * (slip_derivative(r, c, normal, across) - normal[r] * leaning[c])
            slope[r, c] -= hold * away * (turn[r, c] - across[r] * turned)
            if not sticks:
                slope[r, c] -= friction * rise * size * across[r] * normal[c]
    for r in range(3):
        slip[r] *= hold / stiffness  # what is left of it
    for r in range(3):
        force[r] = push * normal[r] - stiffness * slip[r]
    return push


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def _all_forces(x, contacts, forces):  # type: ignore[no-untyped-def]
    """Fill `forces`, a `Forces`, with those of `contacts` at node positions x."""
    pairs, stencil, weights, law = contacts.pairs, contacts.stencil, contacts.weights, contacts.law
    before, carried, leads, stiffness = contacts.before, contacts.carried, contacts.lead, contacts.stiffness
    gradient, slopes, push, seen = forces.gradient, forces.slope, forces.push, forces.seen
    slips, pull = forces.slip, forces.pull
    gradient[:] = 0.0
    place, was, had = np.empty(3), np.empty(3), np.empty(3)
    normal, force, slip, slope = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    room = (np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3)))
    turned, width = np.empty((3, 3)), stencil.shape[1]
    probe = 0
    rotation, translation, field = contacts.rotations[0], contacts.translations[0], field_of(contacts.fields, 0)
    for c in range(len(pairs)):
        if pairs[c, 0] != probe:  # slices of arrays are dear: only where they change
            probe = pairs[c, 0]
            rotation, translation = contacts.rotations[probe], contacts.translations[probe]
            field = field_of(contacts.fields, probe)
        x0, x1, x2 = -translation[0], -translation[1], -translation[2]
        for i in range(width):
            w, node = weights[c, i], stencil[c, i]
            x0 += w * x[node, 0]
            x1 += w * x[node, 1]
            x2 += w * x[node, 2]
        moved = 0.0
        for r in range(3):
            place[r] = rotation[0, r] * x0 + rotation[1, r] * x1 + rotation[2, r] * x2
            moved += (place[r] - seen[c, r]) ** 2
        if STEEPEST**2 * moved < seen[c, 3] ** 2:
            push[c] = 0.0
            for r in range(3):
                slips[c, r], pull[c, r] = 0.0, 0.0
            continue
        for r in range(3):
            was[r], had[r] = before[c, r], carried[c, r]
        pushed = point_force(
            place, was, had, leads[c], stiffness[pairs[c, 1]], law, field, normal, force, slip, slope, room,
        )
        for r in range(3):
            slips[c, r] = slip[r]
        push[c], seen[c, 3] = pushed, 0.0
        if pushed <= 0.0:
            # No contact: it is the negative distance from the gap.
            push[c], seen[c, 3] = 0.0, -pushed
            for r in range(3):
                seen[c, r], pull[c, r] = place[r], 0.0
            continue
        f0 = rotation[0, 0] * force[0] + rotation[0, 1] * force[1] + rotation[0, 2] * force[2]
        f1 = rotation[1, 0] * force[0] + rotation[1, 1] * force[1] + rotation[1, 2] * force[2]
        f2 = rotation[2, 0] * force[0] + rotation[2, 1] * force[1] + rotation[2, 2] * force[2]
        pull[c, 0], pull[c, 1], pull[c, 2] = f0, f1, f2
        for i in range(width):
            w, node = weights[c, i], stencil[c, i]
            gradient[node, 0] -= w * f0
            gradient[node, 1] -= w * f1
            gradient[node, 2] -= w * f2
        for r in range(3):
            for q in range(3):
                turned[r, q] = (
                    rotation[r, 0] * slope[0, q] + rotation[r, 1] * slope[1, q] + rotation[r, 2] * slope[2, q]
                )
        for r in range(3):
            for q in range(3):
                slopes[c, r, q] = (
                    turned[r, 0] * rotation[q, 0] + turned[r, 1] * rotation[q, 1] + turned[r, 2] * rotation[q, 2]
                )


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def _unbalanced(gradient, lam, error):  # type: ignore[no-untyped-def]
    """Fills `error` with g − λ; returns its norm relative to that of g."""
    total, off = 0.0, 0.0
    for i in range(len(gradient)):
        for r in range(3):
            g = gradient[i, r]
            error[3 * i + r] = g - lam[3 * i + r]
            total += g * g
            off += error[3 * i + r] ** 2
    return np.sqrt(off) / max(np.sqrt(total), 1e-2)


@numba.njit(cache=True, nogil=True)
def solve_step(  # type: ignore[no-untyped-def]
    free, lift, compliance, start, contacts, first, clear, tolerance, limits,
):
    """Forces λ on the nodes near the probe in equilibrium with contact at one placement of the probes.

    Args:
        free: where the nodes lie without contact [mm], shape (n, 3).
        lift: by how much that differs from where `start` holds them in equilibrium [mm], shape (n, 3).
        compliance: of these nodes, shape (3 n, 3 n).
        start: first guess of λ, shape (3 n,).
        contacts: a `Contacts`; its stencil counts the nodes here.
        first: which of them may push in the first step of Newton's method, flags (c,). What the probe has come upon is
            far more than what it touches once those that it holds already have given way.
        clear: a first `Forces.seen`.
        tolerance: of the forces, relative.
        limits: the most iterations of Newton's method from one guess, and the most tries of all: an iteration whose
            step is shortened tries several lengths.

    Returns:
        λ with which the nodes lie where the `Forces` belong to, these, whether it converged, tries.
    """
    m, count = len(start), len(contacts.pairs)
    n = m // 3
    lam, y = start.copy(), np.empty(m)
    gradient = np.zeros((n, 3))
    forces = Forces(
        gradient, np.empty((count, 3, 3)), np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3)), clear,
    )
    rest = free.copy().reshape(m)
    error, change, move = np.empty(m), np.empty(m), np.empty(m)
    _moved(compliance, lam, y)
    raised = lift.copy().reshape(m)
    if np.abs(raised).max() > 0.0:
        # Without the probe the skin would rise; held by it, it stays: Δλ = (1 + H W)⁻¹ H lift.
        _all_forces((rest - raised + y).reshape(n, 3), contacts, forces)
        resistance(contacts, forces, raised, error)
        if newton_direction(compliance, contacts, forces, error, change, move):
            for i in range(m):
                lam[i] += change[i]
            _moved(compliance, lam, y)
    begin = lam.copy()
    _all_forces((rest + y).reshape(n, 3), contacts, forces)
    for c in range(count):
        if not first[c] and forces.push[c] > 0.0:
            _leave_out(c, contacts, forces)
    _unbalanced(gradient, lam, error)
    if newton_direction(compliance, contacts, forces, error, change, move):
        length = min(1.0, _LARGEST_MOVE / max(np.abs(move).max(), 1e-12))
        for i in range(m):
            y[i] -= length * move[i]
            lam[i] += length * change[i]
    converged, tries = _search(rest, compliance, contacts, forces, y, lam, tolerance, (limits[0], limits[1] - 1))
    tries += 1
    if not converged and tries < limits[1]:
        lam[:] = begin
        _moved(compliance, lam, y)
        again = limits[0], limits[1] - tries
        converged, more = _search(rest, compliance, contacts, forces, y, lam, tolerance, again)
        tries += more
    return lam, forces, converged, tries


@numba.njit(cache=True, nogil=True)
def _moved(compliance, lam, y):  # type: ignore[no-untyped-def]
    """Fills y with −W λ."""
    symmetric_times(compliance, lam, y)
    for i in range(len(y)):
        y[i] = -y[i]


@numba.njit(cache=True, nogil=True)
def _leave_out(c, contacts, forces):  # type: ignore[no-untyped-def]
    """Take contact c out of `forces`."""
    forces.push[c] = 0.0
    for i in range(contacts.stencil.shape[1]):
        for r in range(3):
            forces.gradient[contacts.stencil[c, i], r] += contacts.weights[c, i] * forces.pull[c, r]


@numba.njit(cache=True, nogil=True)
def _search(rest, compliance, contacts, forces, y, lam, tolerance, limits):  # type: ignore[no-untyped-def]
    """Newton's method from y and λ, which it changes, each step shortened until the error falls.

    Returns whether it converged, and tries.
    """
    m = len(lam)
    n, gradient = m // 3, forces.gradient
    error, change, move, response = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    stuck, tries = 0, 0
    _all_forces((rest + y).reshape(n, 3), contacts, forces)
    for _ in range(limits[0]):
        if _unbalanced(gradient, lam, error) <= tolerance:
            return True, tries
        if tries >= limits[1]:
            return False, tries
        symmetric_times(compliance, error, response)
        size = (error * response).sum()
        if not newton_direction(compliance, contacts, forces, error, change, move):
            return False, tries
        length, best, least = min(1.0, _LARGEST_MOVE / max(np.abs(move).max(), 1e-12)), 0.0, np.inf
        for _ in range(7):
            tries += 1
            _all_forces((rest + y - length * move).reshape(n, 3), contacts, forces)
            for i in range(m):
                error[i] = gradient[i // 3, i % 3] - lam[i] - length * change[i]
            symmetric_times(compliance, error, response)
            left = (error * response).sum()
            if left < least:
                least, best = left, length
            if left <= (1.0 - 0.2 * length) * size:
                break
            length *= 0.5
        if best != length:
            length = best
            _all_forces((rest + y - length * move).reshape(n, 3), contacts, forces)
        for i in range(m):
            y[i] -= length * move[i]
            lam[i] += length * change[i]
        stuck = stuck + 1 if least > (1.0 - _GAIN) * size else 0
        if stuck == _STUCK:
            return False, tries
    return False, tries
