"""The law of frictional contact, compiled: a penalty along the normal, Coulomb friction by return mapping across it.

Every contact, in the solver and in predictions from the pose, calls these functions; what differs between the two is
only how pairs, normals and places are found.

Normal contact. With the violation v = g − d of the gap g at distance d the energy is

    φ(v) = 0                              v ≤ 0
         = k v³ / (6 δ)                   0 < v < δ
         = k (v²/2 − δ v/2 + δ²/6)        v ≥ δ

and the normal force N = φ'(v). φ is twice differentiable; δ is the violation over which the stiffness sets in.

Friction. With the elastic slip e across the normal n the force is T = k_t e while k_t |e| ≤ μ N (stick), otherwise
T = μ N e/|e| (slip); what is left of the slip is T / k_t (J. C. Simo and T. A. Laursen, An augmented Lagrangian
treatment of contact problems involving friction, Computers & Structures 42, 1992: its penalty regularization). The
derivative with the direction u = e/|e| in slip and u = 0 in stick is

    ∂T/∂e = f (1 − n nᵀ − u uᵀ),    ∂T/∂N = μ u,    f = k_t in stick, μ N / |e| in slip.

Numba caches each file on its own: after a change here touch the kernels that call it, those of `mixpinn.fem.contact`
and those of `mixpinn.press`.
"""

from typing import NamedTuple

import numba
import numpy as np

# mypy cannot see through numba's decorators: the functions are untyped, their callers are not.


class ContactConstants(NamedTuple):
    """Constants of the law.

    Attributes:
        stiffness: k [N/mm].
        smoothing: δ [mm].
        friction: μ.
        slip_stiffness: k_t [N/mm].
    """

    stiffness: float
    smoothing: float
    friction: float
    slip_stiffness: float


@numba.njit(cache=True, nogil=True)
def penalty(violation, stiffness, smoothing):  # type: ignore[no-untyped-def]
    """φ [N mm], φ' = N [N] and φ'' [N/mm] at a violation v [mm]."""
    v, k, delta = violation, stiffness, smoothing
    if v <= 0.0:
        return 0.0, 0.0, 0.0
    if v < delta:
        return k * v**3 / (6.0 * delta), k * v * v / (2.0 * delta), k * v / delta
    return k * (0.5 * v * v - 0.5 * delta * v + delta * delta / 6.0), k * (v - 0.5 * delta), k


@numba.njit(cache=True, nogil=True)
def penalties(violation, stiffness, smoothing):  # type: ignore[no-untyped-def]
    """`penalty` of each of n violations (n,), with a smoothing of each (n,) and one stiffness: shape (3, n)."""
    found = np.empty((3, len(violation)))
    for i in range(len(violation)):
        found[0, i], found[1, i], found[2, i] = penalty(violation[i], stiffness, smoothing[i])
    return found


@numba.njit(cache=True, nogil=True)
def return_slip(slip, normal, limit, slip_stiffness, direction):  # type: ignore[no-untyped-def]
    """Take the part of `slip` (3,) across `normal` (3,), and map it back to the cone |T| ≤ `limit` = μ N.

    Fills `slip` with its part across the normal, e, and `direction` with u; the force is T = f e and the slip that is
    left T / k_t.

    Returns:
        f [N/mm], whether the contact sticks, and the energy of friction at this N [N mm].
    """
    along = slip[0] * normal[0] + slip[1] * normal[1] + slip[2] * normal[2]
    size = 0.0
    for r in range(3):
        slip[r] -= along * normal[r]
        size += slip[r] * slip[r]
    size = np.sqrt(size)
    if slip_stiffness * size <= limit:
        for r in range(3):
            direction[r] = 0.0
        return slip_stiffness, True, 0.5 * slip_stiffness * size * size
    for r in range(3):
        direction[r] = slip[r] / size
    return limit / size, False, limit * (size - 0.5 * limit / slip_stiffness)


@numba.njit(cache=True, nogil=True)
def slip_derivative(r, c, normal, direction):  # type: ignore[no-untyped-def]
    """Entry (r, c) of ∂T/∂e divided by f: 1 − n nᵀ − u uᵀ."""
    value = -normal[r] * normal[c] - direction[r] * direction[c]
    return value + 1.0 if r == c else value
