"""Laws of joints between two rigid parts: energy, wrench and tangent of the parts' relative motion; no state.

A law sees only q = (u, θ) of `mixpinn.physics.joint_motion`: displacement [mm] and rotation vector [rad] of the second
part in the joint's axes on the first. Objectivity, equal and opposite wrenches and the chain rule through finite
rotations are then settled there, once for every law.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.physics.contact_law import penalty

Six = tuple[float, float, float, float, float, float]
"""Three entries for translations, then three for rotations, along and about the joint's axes."""


@runtime_checkable
class JointLaw(Protocol):
    """Elastic law of a joint; frozen dataclasses of plain values are recorded in stores by their fields."""

    def energy(self, motion: FloatArray) -> float:
        """E(q) [N mm] at the motion q [mm, rad], shape (6,)."""
        ...

    def wrench(self, motion: FloatArray) -> FloatArray:
        """∂E/∂q [N, N mm], shape (6,)."""
        ...

    def tangent(self, motion: FloatArray) -> FloatArray:
        """∂²E/∂q² [N/mm, N/rad, N mm/rad], symmetric, shape (6, 6)."""
        ...


@dataclass(frozen=True)
class LinearBushing:
    """E = ½ qᵀ K q.

    Attributes:
        stiffness: K, symmetric positive semi-definite: N/mm among translations, N mm/rad among rotations, N (per rad,
            or N mm per mm) between the two; rows of a 6 × 6 matrix.

    Raises:
        InputError: not such a matrix.
    """

    stiffness: tuple[Six, ...]

    def __post_init__(self) -> None:
        matrix = _numbers("stiffness of a bushing", self.stiffness, (6, 6))
        scale = np.sqrt(np.abs(np.diagonal(matrix)))
        scaled = matrix / np.maximum(np.outer(scale, scale), np.finfo(float).tiny)
        if not np.allclose(matrix, matrix.T, rtol=1e-12, atol=0.0) or np.linalg.eigvalsh(scaled).min() < -1e-9:
            raise InputError(
                "stiffness of a bushing", expected="a symmetric matrix without negative eigenvalues",
                got="another one", fix="check signs and order: three translations, then three rotations",
            )
        object.__setattr__(self, "stiffness", tuple(tuple(row) for row in matrix.tolist()))

    @staticmethod
    def of_diagonal(stiffness: Sequence[float]) -> "LinearBushing":
        """Uncoupled: k_x, k_y, k_z [N/mm] and about x, y, z [N mm/rad]."""
        return LinearBushing(np.diag(_numbers("stiffness of a bushing", stiffness, (6,))).tolist())

    @cached_property
    def _matrix(self) -> FloatArray:
        return np.array(self.stiffness)

    def energy(self, motion: FloatArray) -> float:
        """½ qᵀ K q [N mm]."""
        return 0.5 * float(motion @ self._matrix @ motion)

    def wrench(self, motion: FloatArray) -> FloatArray:
        """K q [N, N mm], shape (6,)."""
        product: FloatArray = self._matrix @ motion
        return product

    def tangent(self, motion: FloatArray) -> FloatArray:
        """K, shape (6, 6)."""
        return self._matrix.copy()


@dataclass(frozen=True)
class NeutralZoneBushing:
    """A lax neutral zone, stiffer beyond it, with a preload; the six components are uncoupled.

    With φ(v; k, δ) of `mixpinn.physics.contact_law` (twice differentiable, its stiffness rises from 0 to k over δ)

        E = Σ_i p_i q_i + ½ k⁰_i q_i² + φ(q_i − z_i; k⁺_i − k⁰_i, δ_i) + φ(−q_i − z_i; k⁻_i − k⁰_i, δ_i).

    A preload leaves the rest configuration under stress: it is in equilibrium only where something carries it.

    Attributes:
        lax: k⁰, stiffness within the neutral zone [N/mm, N mm/rad].
        positive, negative: k⁺, k⁻, stiffness far beyond its ends, not less than k⁰ [N/mm, N mm/rad].
        zone: z, half width of the neutral zone [mm, rad].
        transition: δ > 0, length over which the stiffness rises [mm, rad].
        preload: p, the wrench at q = 0 that acts on the first part's side [N, N mm].

    Raises:
        InputError: not six numbers, or out of range.
    """

    lax: Six
    positive: Six
    negative: Six
    zone: Six
    transition: Six
    preload: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        values = {}
        for name in ("lax", "positive", "negative", "zone", "transition", "preload"):
            values[name] = _numbers(f"{name} of a bushing with neutral zone", getattr(self, name), (6,))
            object.__setattr__(self, name, tuple(values[name].tolist()))
        beyond = np.minimum(values["positive"], values["negative"])
        if (values["lax"] < 0.0).any() or (beyond < values["lax"]).any() or (values["zone"] < 0.0).any() or (
            values["transition"] <= 0.0
        ).any():
            raise InputError(
                "bushing with neutral zone", expected="0 ≤ lax ≤ positive, negative; zone ≥ 0; transition > 0",
                got="other values", fix="lax is the stiffness within the zone, positive and negative those beyond it",
            )

    def _parts(self, motion: FloatArray) -> FloatArray:
        """Energy, force and stiffness of each component without the preload, shape (6, 3)."""
        rows = np.empty((6, 3))
        for i, q in enumerate(motion.tolist()):
            lax, zone, rise = self.lax[i], self.zone[i], self.transition[i]
            ahead = penalty(q - zone, self.positive[i] - lax, rise)
            behind = penalty(-q - zone, self.negative[i] - lax, rise)
            rows[i] = (
                0.5 * lax * q * q + ahead[0] + behind[0], lax * q + ahead[1] - behind[1], lax + ahead[2] + behind[2],
            )
        return rows

    def energy(self, motion: FloatArray) -> float:
        """E(q) [N mm]."""
        return float(self._parts(motion)[:, 0].sum() + np.asarray(self.preload) @ motion)

    def wrench(self, motion: FloatArray) -> FloatArray:
        """∂E/∂q [N, N mm], shape (6,)."""
        return self._parts(motion)[:, 1] + np.asarray(self.preload)

    def tangent(self, motion: FloatArray) -> FloatArray:
        """∂²E/∂q², diagonal, shape (6, 6)."""
        return np.diag(self._parts(motion)[:, 2])


def _numbers(what: str, values: Sequence[object] | AnyArray, shape: tuple[int, ...]) -> FloatArray:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape or not np.isfinite(array).all():
        size = " × ".join(str(n) for n in shape)
        raise InputError(what, expected=f"{size} finite numbers", got=f"{values!r}"[:60], fix=f"give {size} numbers")
    return array
