"""A symmetric solve in two halves around some unknowns: contact needs the first half, the step needs the second.

With A = L Lᵀ but for the block of the unknowns k that are eliminated last, the first half of A x = b gives z = L⁻¹ b
for the other unknowns i and f = b_k − A_ki A_ii⁻¹ b_i. Then x_k = W f, with W the block of the inverse that belongs
to k, and the second half gives x_i. Forces λ on the unknowns k change nothing but f, by λ. Products aᵀ A⁻¹ b need no
second half either: they are z_a · z_b + f_a · W f_b.

Near equilibrium with contact, b_k is large and b_i small: the first half is taken of b_i alone, so that single
precision rounds what is small.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.fem.solve.linear import LinearSolver
from mixpinn.fem.solve.pardiso import PardisoSolver


@dataclass(frozen=True, eq=False)
class Half:
    """A vector b after the first half; linear in b.

    Attributes:
        image: z, zero for the kept unknowns, shape (n,).
        force: f, shape (m,).
        kept: kept part of A⁻¹ b, shape (m,).
    """

    image: FloatArray
    force: FloatArray
    kept: FloatArray


class Halves(Protocol):
    """A factorization of n unknowns, of which m are kept for contact.

    Attributes:
        kept: these unknowns, ascending, shape (m,).
        compliance: their block W of the inverse, shape (m, m).
        size: n.
        number: type of the numbers in an image.
    """

    kept: IntArray
    compliance: FloatArray
    size: int
    number: Any

    def forward(self, vector: FloatArray) -> Half:
        """The first half for a vector (n,)."""
        ...

    def dual(self, half: Half, vector: FloatArray) -> FloatArray:
        """What images must be multiplied with, (n,), for products with A⁻¹ times `vector`, whose `half` is given.

        The product of a and b is image_a · dual_b + kept_a · force_b.
        """
        ...

    def backward(self, image: FloatArray, kept: FloatArray, force: FloatArray) -> FloatArray:
        """A⁻¹ (b + Sᵀ λ), shape (n,), from the image of b, the kept part of the answer and λ, both (m,)."""
        ...


class CholeskyHalves:
    """The two triangular solves of a Cholesky factorization; see `Halves`."""

    def __init__(self, solver: PardisoSolver, size: int, kept: IntArray, compliance: FloatArray) -> None:
        self._solver, self.size, self.kept, self.compliance = solver, size, kept, compliance
        self.number = solver.number

    def forward(self, vector: FloatArray) -> Half:
        """See `Halves.forward`."""
        others = vector.copy()
        others[self.kept] = 0.0
        image = self._solver.forward(others)
        force = vector[self.kept] + image[self.kept]
        image[self.kept] = 0.0
        return Half(image, force, np.einsum("ij,j->i", self.compliance, force))

    def dual(self, half: Half, vector: FloatArray) -> FloatArray:
        """See `Halves.dual`."""
        return half.image

    def backward(self, image: FloatArray, kept: FloatArray, force: FloatArray) -> FloatArray:
        """See `Halves.backward`."""
        image = image.copy()
        image[self.kept] = kept
        moved = self._solver.backward(image).astype(np.float64)
        moved[self.kept] = kept
        return moved


class WholeSolves:
    """For solvers that cannot be split: an image is the whole solution; see `Halves`."""

    def __init__(self, solver: LinearSolver, size: int, kept: IntArray, compliance: FloatArray) -> None:
        self._solver, self.size, self.kept, self.compliance = solver, size, kept, compliance
        self.number = np.float64

    def forward(self, vector: FloatArray) -> Half:
        """See `Halves.forward`."""
        image = self._solver.solve(vector)
        return Half(image, np.zeros(len(self.kept)), image[self.kept])

    def dual(self, half: Half, vector: FloatArray) -> FloatArray:
        """See `Halves.dual`."""
        return vector

    def backward(self, image: FloatArray, kept: FloatArray, force: FloatArray) -> FloatArray:
        """See `Halves.backward`."""
        if not force.any():
            return image.copy()
        load = np.zeros(self.size)
        load[self.kept] = force
        return image + self._solver.solve(load)


def in_halves(solver: LinearSolver, size: int, kept: IntArray, compliance: FloatArray) -> Halves:
    """The last factorization of `solver`, of a matrix (size, size), as halves around the unknowns `kept`."""
    if isinstance(solver, PardisoSolver) and solver.halves:
        return CholeskyHalves(solver, size, kept, compliance)
    return WholeSolves(solver, size, kept, compliance)
