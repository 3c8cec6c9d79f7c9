"""
One's own material law
======================

Any object with three methods is a material: energy, stress, tangent, as functions of the deformation gradient F. This
one is Saint Venant-Kirchhoff: quadratic in Green's strain, the simplest law that is indifferent to rotation.
"""

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import LinearElastic, StableNeoHookean

# %%
# With the strain E = (FᵀF − 1)/2 the energy is Ψ = μ E:E + λ/2 (tr E)². Its derivative by E is S = 2 μ E + λ tr E 1;
# the stress is P = F S, and the tangent follows by the product rule. F has shape (m, 3, 3), one matrix a cell.


@dataclass(frozen=True)
class SaintVenantKirchhoff:
    """Constants [N/mm²]."""

    mu: float
    lam: float

    def strain(self, deformation: FloatArray) -> FloatArray:
        """E, shape (m, 3, 3)."""
        return 0.5 * (np.swapaxes(deformation, 1, 2) @ deformation - np.eye(3))

    def energy(self, deformation: FloatArray) -> FloatArray:
        """Ψ [N/mm²], shape (m,)."""
        strain = self.strain(deformation)
        return self.mu * (strain**2).sum(axis=(1, 2)) + 0.5 * self.lam * np.trace(strain, axis1=1, axis2=2) ** 2

    def gradient(self, deformation: FloatArray) -> FloatArray:
        """P = ∂Ψ/∂F [N/mm²], shape (m, 3, 3)."""
        return deformation @ self._second_stress(deformation)

    def hessian(self, deformation: FloatArray) -> FloatArray:
        """∂P/∂F [N/mm²], shape (m, 9, 9)."""
        f, s, one = deformation, self._second_stress(deformation), np.eye(3)
        tangent = (
            np.einsum("ik,mlj->mijkl", one, s)
            + self.mu * np.einsum("mil,mkj->mijkl", f, f)
            + self.mu * np.einsum("mia,mka,lj->mijkl", f, f, one)
            + self.lam * np.einsum("mij,mkl->mijkl", f, f)
        )
        return tangent.reshape(-1, 9, 9)

    def _second_stress(self, deformation: FloatArray) -> FloatArray:
        strain = self.strain(deformation)
        trace = np.trace(strain, axis1=1, axis2=2)
        return 2.0 * self.mu * strain + self.lam * trace[:, None, None] * np.eye(3)


law = SaintVenantKirchhoff(mu=8.76e-3, lam=78.8e-3)

# %%
# **Check.** Stress and tangent are the derivatives of the energy: central differences along random directions agree
# to their own order, so that half the step leaves a quarter of the difference.

rng = np.random.default_rng(0)
f = np.eye(3) + 0.2 * rng.standard_normal((20, 3, 3))
way = rng.standard_normal((20, 3, 3))


def difference(step: float) -> float:
    """Largest difference between the stress along `way` and the energy's central difference [N/mm²]."""
    slope = (law.energy(f + step * way) - law.energy(f - step * way)) / (2.0 * step)
    return float(np.abs(slope - (law.gradient(f) * way).sum(axis=(1, 2))).max())


ratio = difference(1e-2) / difference(5e-3)
print(f"half the step, {ratio:.3f} times less difference")
assert abs(ratio - 4.0) < 0.01

step = 1e-5
slope = (law.gradient(f + step * way) - law.gradient(f - step * way)) / (2.0 * step)
tangent = (law.hessian(f) @ way.reshape(20, 9, 1)).reshape(20, 3, 3)
assert np.abs(slope - tangent).max() < 1e-7 * np.abs(tangent).max()

# At rest it is linear elasticity, and turning the body stores no energy.
rest = np.eye(3)[None]
assert np.allclose(law.hessian(rest), LinearElastic(law.mu, law.lam).hessian(rest))
turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
assert np.allclose(law.energy(turn @ f), law.energy(f))

# %%
# It is used like any other: ``Scene(mesh, probe, (law,))``, or ``ElasticSystem(mesh, [law])``. Keep such a class in a
# module of its own, so that worker processes can import it. Beside the built-in law, the energy of a stretch along x:

stretch = np.linspace(0.6, 1.6, 101)
deformation = np.tile(np.eye(3), (len(stretch), 1, 1))
deformation[:, 0, 0] = stretch
figure, axes = plt.subplots(figsize=(5.5, 3.5), layout="constrained")
axes.plot(stretch, 1e3 * law.energy(deformation), label="Saint Venant-Kirchhoff")
axes.plot(stretch, 1e3 * StableNeoHookean(law.mu, law.lam).energy(deformation), label="Stable Neo-Hookean")
axes.set(xlabel="stretch", ylabel="energy density [kPa]")
axes.legend(frameon=False)
