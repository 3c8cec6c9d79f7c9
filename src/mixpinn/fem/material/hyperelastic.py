"""Materials: energy density, stress and tangent as functions of the deformation gradient F = ∂x/∂X."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError

_IDENTITY = np.eye(3)
_LEVI_CIVITA = np.zeros((3, 3, 3))
_LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_LEVI_CIVITA[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1.0


class Material(Protocol):
    """A hyperelastic material: what a class must offer to be used by `ElasticSystem`.

    All three take deformation gradients of m cells, shape (m, 3, 3), and are evaluated cell by cell. Any class with
    these methods will do; NumPy is enough. The built-in materials are also compiled, see
    `mixpinn.physics.energies`.
    """

    def energy(self, deformation: FloatArray) -> FloatArray:
        """Energy density Ψ(F) per rest volume [N/mm²], shape (m,); zero at rest."""
        ...

    def gradient(self, deformation: FloatArray) -> FloatArray:
        """First Piola-Kirchhoff stress P = ∂Ψ/∂F [N/mm²], shape (m, 3, 3)."""
        ...

    def hessian(self, deformation: FloatArray) -> FloatArray:
        """Tangent ∂²Ψ/∂F∂F [N/mm²], shape (m, 9, 9); row 3i + j, column 3k + l belong to F_ij, F_kl."""
        ...


@dataclass(frozen=True)
class _Lame:
    """Lamé constants of the linearised material.

    Attributes:
        mu: shear modulus μ [N/mm²].
        lam: first Lamé constant λ [N/mm²].

    Raises:
        InputError: constants for which the material is not stable.
    """

    mu: float
    lam: float

    def __post_init__(self) -> None:
        if not (np.isfinite([self.mu, self.lam]).all() and self.mu > 0.0 and 3.0 * self.lam + 2.0 * self.mu > 0.0):
            raise InputError(
                type(self).__name__, expected="mu > 0 and 3 lam + 2 mu > 0", got=f"mu={self.mu}, lam={self.lam}",
                fix="correct the constants [N/mm²]",
            )

    @classmethod
    def from_young(cls, young: float, poisson: float) -> Self:
        """Material from Young's modulus [N/mm²] and Poisson's ratio: μ = E/(2(1+ν)), λ = Eν/((1+ν)(1−2ν)).

        Raises:
            InputError: E not positive or ν outside (−1, 1/2).

        Example:
            >>> round(StableNeoHookean.from_young(25.4e-3, 0.45).mu, 9)
            0.008758621
        """
        if not (young > 0.0 and -1.0 < poisson < 0.5):
            raise InputError(
                cls.__name__, expected="young > 0 and -1 < poisson < 0.5", got=f"young={young}, poisson={poisson}",
                fix="correct the constants; nearly incompressible tissue takes a ratio slightly below 0.5",
            )
        return cls(young / (2.0 * (1.0 + poisson)), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)))


@dataclass(frozen=True)
class StableNeoHookean(_Lame):
    """Stable Neo-Hookean without the logarithm (Kim & Eberle 2022), the form that SOFA computes.

    With I_C = F : F, J = det F, α = 1 + μ/(λ + μ):

    - Ψ = μ/2 (I_C − 3) + (λ + μ)/2 (J − α)², less its value at rest, (λ + μ)/2 (1 − α)² = μ²/(2(λ + μ));
    - P = μ F + (λ + μ)(J − α) cof F, since ∂J/∂F = cof F;
    - ∂P/∂F = μ 1 + (λ + μ) cof F ⊗ cof F + (λ + μ)(J − α) ∂²J/∂F².

    At rest (λ + μ)(1 − α) = −μ cancels the stress. λ, μ are the Lamé constants of the linearised material. The energy
    is finite for J ≤ 0: it does not forbid inversion.
    """

    def energy(self, deformation: FloatArray) -> FloatArray:
        """Energy density, see `Material.energy`."""
        # (λ + μ)/2 ((J − α)² − (1 − α)²) = (λ + μ)/2 (J − 1)² − μ (J − 1)
        shear, growth = _invariant(deformation) - 3.0, np.linalg.det(deformation) - 1.0
        energy: FloatArray = 0.5 * self.mu * shear + 0.5 * (self.lam + self.mu) * growth**2 - self.mu * growth
        return energy

    def gradient(self, deformation: FloatArray) -> FloatArray:
        """First Piola-Kirchhoff stress, see `Material.gradient`."""
        pressure = (self.lam + self.mu) * (np.linalg.det(deformation) - 1.0) - self.mu
        stress: FloatArray = self.mu * deformation + pressure[:, None, None] * _cofactor(deformation)
        return stress

    def hessian(self, deformation: FloatArray) -> FloatArray:
        """Tangent, see `Material.hessian`."""
        bulk = self.lam + self.mu
        pressure = bulk * (np.linalg.det(deformation) - 1.0) - self.mu
        cofactor = _cofactor(deformation).reshape(-1, 9)
        tangent: FloatArray = (
            self.mu * np.eye(9) + bulk * _outer(cofactor)
            + pressure[:, None, None] * _second_derivative_of_j(deformation)
        )
        return tangent


@dataclass(frozen=True)
class StableNeoHookeanLog(_Lame):
    """Stable Neo-Hookean with the logarithmic barrier (Smith, de Goes & Kim 2018, equation 14).

    With m = 4/3 μ, l = λ + 5/6 μ (which make λ, μ the Lamé constants of the linearised material) and
    α = 1 + m/l − m/(4l):

    - Ψ = m/2 (I_C − 3) + l/2 (J − α)² − m/2 log(I_C + 1), less its value at rest;
    - P = m (1 − 1/(I_C + 1)) F + l (J − α) cof F;
    - ∂P/∂F = m (1 − 1/(I_C + 1)) 1 + 2m/(I_C + 1)² F ⊗ F + l cof F ⊗ cof F + l (J − α) ∂²J/∂F².

    The logarithm is a barrier against F = 0 only; inversion stays possible here too.
    """

    @property
    def _moduli(self) -> tuple[float, float]:
        return 4.0 / 3.0 * self.mu, self.lam + 5.0 / 6.0 * self.mu

    def energy(self, deformation: FloatArray) -> FloatArray:
        """Energy density, see `Material.energy`."""
        m, bulk = self._moduli
        shear, growth = _invariant(deformation) - 3.0, np.linalg.det(deformation) - 1.0
        # l/2 ((J − α)² − (1 − α)²) = l/2 (J − 1)² − 3/4 m (J − 1);  log(I_C + 1) − log 4 = log1p((I_C − 3)/4)
        energy: FloatArray = (
            0.5 * m * (shear - np.log1p(0.25 * shear)) + 0.5 * bulk * growth**2 - 0.75 * m * growth
        )
        return energy

    def gradient(self, deformation: FloatArray) -> FloatArray:
        """First Piola-Kirchhoff stress, see `Material.gradient`."""
        m, bulk = self._moduli
        pressure = bulk * (np.linalg.det(deformation) - 1.0) - 0.75 * m
        shear = m * (1.0 - 1.0 / (_invariant(deformation) + 1.0))
        stress: FloatArray = shear[:, None, None] * deformation + pressure[:, None, None] * _cofactor(deformation)
        return stress

    def hessian(self, deformation: FloatArray) -> FloatArray:
        """Tangent, see `Material.hessian`."""
        m, bulk = self._moduli
        pressure = bulk * (np.linalg.det(deformation) - 1.0) - 0.75 * m
        trace = (_invariant(deformation) + 1.0)[:, None, None]
        tangent: FloatArray = (
            m * (1.0 - 1.0 / trace) * np.eye(9) + 2.0 * m / trace**2 * _outer(deformation.reshape(-1, 9))
            + bulk * _outer(_cofactor(deformation).reshape(-1, 9))
            + pressure[:, None, None] * _second_derivative_of_j(deformation)
        )
        return tangent


@dataclass(frozen=True)
class LinearElastic(_Lame):
    """Linear elasticity: Ψ = μ ε : ε + λ/2 (tr ε)², ε = (F + Fᵀ)/2 − 1, P = 2μ ε + λ tr ε 1.

    For small displacements and for comparisons only: not objective, a rotation causes stress.
    """

    def energy(self, deformation: FloatArray) -> FloatArray:
        """Energy density, see `Material.energy`."""
        strain = 0.5 * (deformation + np.swapaxes(deformation, 1, 2)) - _IDENTITY
        energy: FloatArray = self.mu * _invariant(strain) + 0.5 * self.lam * np.trace(strain, axis1=1, axis2=2) ** 2
        return energy

    def gradient(self, deformation: FloatArray) -> FloatArray:
        """First Piola-Kirchhoff stress, see `Material.gradient`."""
        strain = 0.5 * (deformation + np.swapaxes(deformation, 1, 2)) - _IDENTITY
        trace = np.trace(strain, axis1=1, axis2=2)
        stress: FloatArray = 2.0 * self.mu * strain + self.lam * trace[:, None, None] * _IDENTITY
        return stress

    def hessian(self, deformation: FloatArray) -> FloatArray:
        """Tangent, see `Material.hessian`: C_ijkl = μ (δ_ik δ_jl + δ_il δ_jk) + λ δ_ij δ_kl."""
        delta = _IDENTITY
        tangent = (
            self.mu * (np.einsum("ik,jl->ijkl", delta, delta) + np.einsum("il,jk->ijkl", delta, delta))
            + self.lam * np.einsum("ij,kl->ijkl", delta, delta)
        )
        return np.broadcast_to(tangent.reshape(9, 9), (len(deformation), 9, 9)).copy()


PAPER_TISSUE = StableNeoHookean(mu=8.758621e-3, lam=84.666667e-3)
"""The tissue of the paper's simulations [N/mm²]."""

DEFAULT_TISSUE = StableNeoHookean.from_young(25.4e-3, 0.45)
"""Soft tissue of which nothing else is known: E = 25.4 kPa, ν = 0.45 [N/mm²]."""


def _invariant(tensor: FloatArray) -> FloatArray:
    """F : F, shape (m,)."""
    value: FloatArray = np.einsum("mij,mij->m", tensor, tensor)
    return value


def _cofactor(tensor: FloatArray) -> FloatArray:
    """cof F = ∂det F/∂F; its rows are the cross products of the rows of F; shape (m, 3, 3)."""
    a, b, c = tensor[:, 0], tensor[:, 1], tensor[:, 2]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)


def _outer(vectors: FloatArray) -> FloatArray:
    product: FloatArray = vectors[:, :, None] * vectors[:, None, :]
    return product


def _second_derivative_of_j(tensor: FloatArray) -> FloatArray:
    """∂²det F/∂F_jm ∂F_kn = ε_ijk ε_lmn F_il, shape (m, 9, 9)."""
    product = np.einsum("ijk,lmn,cil->cjmkn", _LEVI_CIVITA, _LEVI_CIVITA, tensor, optimize=True)
    return np.ascontiguousarray(product).reshape(-1, 9, 9)
