"""BFGS updates of a factorized tangent, together with the block of the inverse that contact sees."""

from dataclasses import dataclass

import numba
import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.fem.solve.halves import Half, Halves

# Compiled loops rather than BLAS: on vectors this short a second thread is waited for longer than it helps, and very
# long where the cores are shared with other processes.


@numba.njit(cache=True)
def _products(rows, count, vector, out):  # type: ignore[no-untyped-def]
    for i in range(count):
        row, total = rows[i], 0.0
        for k in range(len(vector)):
            total += row[k] * vector[k]
        out[i] = total


@numba.njit(cache=True)
def _add_rows(rows, factors, count, vector):  # type: ignore[no-untyped-def]
    for i in range(count):
        row, factor = rows[i], vector.dtype.type(factors[i])
        for k in range(len(vector)):
            vector[k] += factor * row[k]


@numba.njit(cache=True)
def _coefficients(along, across, cross, square, rhos, count, weights, factors):  # type: ignore[no-untyped-def]
    """The two loops in the span of the pairs; see `UpdatedInverse`."""
    for i in range(count - 1, -1, -1):
        total = along[i]
        for j in range(i + 1, count):
            total -= weights[j] * cross[i, j]
        weights[i] = rhos[i] * total
    for i in range(count):
        total = across[i]
        for j in range(count):
            total -= weights[j] * square[i, j]
        for j in range(i):
            total += factors[j] * cross[j, i]
        factors[i] = weights[i] - rhos[i] * total


@numba.njit(cache=True)
def _updated(block, step, image, rho, scale):  # type: ignore[no-untyped-def]
    """block − ρ (s uᵀ + u sᵀ) + scale s sᵀ."""
    found = np.empty_like(block)
    for i in range(len(step)):
        row, out, s, u = block[i], found[i], step[i], image[i]
        for j in range(len(step)):
            out[j] = row[j] - rho * (s * image[j] + u * step[j]) + scale * (s * step[j])
    return found


@dataclass(frozen=True, eq=False)
class _Pair:
    """A step and the elastic residuals before and after it, shape (n,) each."""

    step: FloatArray
    old: FloatArray
    new: FloatArray


@dataclass(frozen=True, eq=False)
class _Seen:
    """A vector v as the pairs see it: its first half, sᵢᵀ v and yᵢᵀ H₀ v."""

    vector: FloatArray
    half: Half
    along: FloatArray
    across: FloatArray


class UpdatedInverse:
    """An approximate inverse H of the elastic tangent: a factorization H₀ and BFGS pairs s, y.

    The secant condition H y = s, with y the change of the elastic residual over the step s, leaves contact aside, so
    that pairs stay valid whatever touches (H. Matthies and G. Strang, The solution of nonlinear finite element
    equations, International Journal for Numerical Methods in Engineering 14, 1979; two-loop form of J. Nocedal,
    Mathematics of Computation 35, 1980).

    A solve with the factorization is what an iteration costs, and its two halves are all that it needs. Contact asks
    for the kept part of H g, which is known after the forward half (`mixpinn.fem.solve.halves`): of the two loops

        v ← g − Σᵢ wᵢ yᵢ,   wᵢ = ρᵢ sᵢᵀ v (backwards),      H g = H₀ v + Σᵢ cᵢ sᵢ,   cᵢ = wᵢ − ρᵢ yᵢᵀ (H₀ v + Σⱼ cⱼ sⱼ)

    with j < i, both are recursions in the products sᵢᵀ g, yᵢᵀ H₀ g, sᵢᵀ yⱼ and yᵢᵀ H₀ yⱼ. The backward half follows
    once, when contact has found its forces. Images of the y are differences of images of residuals.
    """

    def __init__(self, halves: Halves) -> None:
        self._halves, self.kept = halves, halves.kept
        self._compliance = halves.compliance
        self._count = 0
        n, m = halves.size, len(halves.kept)
        self._steps, self._images = np.empty((0, n), halves.number), np.empty((0, n), halves.number)
        self._step_kept, self._image_kept = np.empty((0, m)), np.empty((0, m))
        self._cross, self._square, self._rhos = np.empty((0, 0)), np.empty((0, 0)), np.empty(0)
        self._pending: _Pair | None = None
        self._seen: _Seen | None = None

    def __len__(self) -> int:
        return self._count + (self._pending is not None)

    @property
    def compliance(self) -> FloatArray:
        """The block of H for the unknowns `kept`, shape (m, m)."""
        self._settle()
        return self._compliance

    def look(self, residual: FloatArray) -> FloatArray:
        """The kept part of H g, shape (m,), for a residual g (n,) that `step` and the pair of the next step refer to.

        The pair that waits is taken in.
        """
        pair, seen = self._pending, self._seen
        if pair is None or seen is None or pair.new is not residual or pair.old is not seen.vector:
            self._settle()
            pair = None
        found = self._see(residual)
        if pair is not None and seen is not None:
            self._pending = None
            new, old = found.half, seen.half
            change = _Seen(
                residual - pair.old,
                Half(new.image - old.image, new.force - old.force, new.kept - old.kept),
                found.along - seen.along, found.across - seen.across,
            )
            self._insert(pair.step, change)
            found = _Seen(
                residual, new, np.append(found.along, _product(pair.step, residual)),
                np.append(found.across, self._with(change.half, found)),
            )
        self._seen = found
        return self._kept_part(found)

    def step(self, force: FloatArray | None = None) -> FloatArray:
        """H (g + Sᵀ λ), shape (n,), for the residual g looked at last and forces λ on the kept unknowns, (m,)."""
        seen, count = self._seen, self._count
        assert seen is not None
        if force is None:
            force = np.zeros(len(self.kept))
        along = seen.along + np.einsum("ij,j->i", self._step_kept[:count], force)
        across = seen.across + np.einsum("ij,j->i", self._image_kept[:count], force)
        weights, factors = self._loops(along, across)
        kept = seen.half.kept + np.einsum("ij,j->i", self._halves.compliance, force)
        kept -= np.einsum("i,ij->j", weights, self._image_kept[:count])
        image = seen.half.image.copy()
        _add_rows(self._images, -weights, count, image)
        moved = self._halves.backward(image, kept, force)
        _add_rows(self._steps, factors, count, moved)
        if len(self.kept):  # as contact saw them, whatever the precision of the rest
            moved[self.kept] = kept + np.einsum("i,ij->j", factors, self._step_kept[:count])
        return moved

    def learn(self, step: FloatArray, old: FloatArray, new: FloatArray, model_change: FloatArray) -> None:
        """Learn that the elastic residual went from `old` to `new` over `step`, where H predicted `model_change`.

        The pair is taken in when `new` is looked at. One that shows less than a hundredth of the curvature expected is
        left out, so that H stays positive.
        """
        self._settle()
        curvature = float((step * (new - old)).sum())
        if curvature > 0.01 * abs(float((step * model_change).sum())):
            self._pending = _Pair(step, old, new)

    def _settle(self) -> None:
        """Take in the pair that waits, by half a solve of its own."""
        pair, self._pending = self._pending, None
        if pair is not None:
            self._insert(pair.step, self._see(pair.new - pair.old))
            self._seen = None

    def _see(self, vector: FloatArray) -> _Seen:
        count = self._count
        half = self._halves.forward(vector)
        along, across = np.empty(count), np.empty(count)
        _products(self._steps, count, vector, along)
        _products(self._images, count, self._halves.dual(half, vector), across)
        return _Seen(vector, half, along, across + np.einsum("ij,j->i", self._image_kept[:count], half.force))

    def _with(self, half: Half, seen: _Seen) -> float:
        """aᵀ H₀ v of the vector a behind `half` and a vector v seen."""
        inner = _product(half.image, self._halves.dual(seen.half, seen.vector))
        return inner + float((half.kept * seen.half.force).sum())

    def _loops(self, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
        weights, factors = np.empty(self._count), np.empty(self._count)
        _coefficients(along, across, self._cross, self._square, self._rhos, self._count, weights, factors)
        return weights, factors

    def _kept_part(self, seen: _Seen) -> FloatArray:
        """The kept part of H v."""
        weights, factors = self._loops(seen.along, seen.across)
        count = self._count
        lost = np.einsum("i,ij->j", weights, self._image_kept[:count])
        found: FloatArray = seen.half.kept - lost + np.einsum("i,ij->j", factors, self._step_kept[:count])
        return found

    def _insert(self, step: FloatArray, change: _Seen) -> None:
        """Append a pair s, y."""
        count, rho, square = self._count, 1.0 / _product(step, change.vector), self._with(change.half, change)
        if len(self.kept):
            s, u = step[self.kept], self._kept_part(change)
            weights, _ = self._loops(change.along, change.across)
            turned = square - 2.0 * float((weights * change.across).sum())  # yᵀ H y
            turned += float(np.einsum("i,ij,j->", weights, self._square[:count, :count], weights))
            turned += float((weights**2 / self._rhos[:count]).sum())
            self._compliance = _updated(self._compliance, s, u, rho, rho * (1.0 + rho * turned))
        if count == len(self._rhos):
            self._grow(count + max(8, count))
        self._steps[count], self._images[count], self._rhos[count] = step, change.half.image, rho
        self._step_kept[count], self._image_kept[count] = step[self.kept], change.half.kept
        self._cross[:count, count], self._cross[count, count] = change.along, 1.0 / rho
        self._square[:count, count] = self._square[count, :count] = change.across
        self._square[count, count] = square
        self._count += 1

    def _grow(self, room: int) -> None:
        for name in ("_steps", "_images", "_step_kept", "_image_kept", "_cross", "_square", "_rhos"):
            old = getattr(self, name)
            shape = (room, room) if name in ("_cross", "_square") else (room, *old.shape[1:])
            new = np.zeros(shape, old.dtype)
            new[tuple(slice(length) for length in old.shape)] = old
            setattr(self, name, new)


def _product(first: FloatArray, second: FloatArray) -> float:
    out = np.empty(1)
    _products(first[None], 1, second, out)
    return float(out[0])
