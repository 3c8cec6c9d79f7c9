"""The equilibrium residual of a displacement field, in single precision and fast enough for every prediction.

What the finite-element solver drives to zero, evaluated for a predicted state: nodal forces f_a = V P G_a of each cell
summed at the nodes, and gathered on the unknowns of `ReducedCoordinates`, where each rigid part has a net
force and a moment about its current centroid. P is that of the Stable Neo-Hookean material without the logarithm
(`mixpinn.fem.StableNeoHookean`): P = μ F + ((λ + μ)(J − 1) − μ) cof F. Written in H = F − 1, so that small strains keep
their digits; single precision leaves about 1e-6 of the forces in a cell, far less than the error of a prediction.
"""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit, prange

from mixpinn.base.arrays import AnyArray, Float32Array, Int32Array, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh
from mixpinn.reduced.coordinates import ReducedCoordinates

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mixpinn.fem import Material

_CHUNKS = 64
"""Loops are cut into so many ranges, whatever the number of threads: results do not vary."""


@njit(parallel=True, fastmath=True, cache=True, error_model="numpy")
def _cell_forces(
    cells: Int32Array, moved: Float32Array, gradients: Float32Array, volume: Float32Array, mu: Float32Array,
    lam: Float32Array, out: Float32Array,
) -> None:
    """V P G_a [N] of all four nodes of each cell into `out` (m, 12); `gradients` (m, 9) hold G_1, G_2, G_3."""
    m = len(cells)
    one = np.float32(1.0)
    for chunk in prange(_CHUNKS):
        for e in range(chunk * m // _CHUNKS, (chunk + 1) * m // _CHUNKS):
            n0, n1, n2, n3 = cells[e, 0], cells[e, 1], cells[e, 2], cells[e, 3]
            u0, u1, u2 = moved[n0, 0], moved[n0, 1], moved[n0, 2]
            a0, a1, a2 = moved[n1, 0] - u0, moved[n1, 1] - u1, moved[n1, 2] - u2
            b0, b1, b2 = moved[n2, 0] - u0, moved[n2, 1] - u1, moved[n2, 2] - u2
            c0, c1, c2 = moved[n3, 0] - u0, moved[n3, 1] - u1, moved[n3, 2] - u2
            p0, p1, p2 = gradients[e, 0], gradients[e, 1], gradients[e, 2]
            q0, q1, q2 = gradients[e, 3], gradients[e, 4], gradients[e, 5]
            r0, r1, r2 = gradients[e, 6], gradients[e, 7], gradients[e, 8]
            h00, h01, h02 = a0 * p0 + b0 * q0 + c0 * r0, a0 * p1 + b0 * q1 + c0 * r1, a0 * p2 + b0 * q2 + c0 * r2
            h10, h11, h12 = a1 * p0 + b1 * q0 + c1 * r0, a1 * p1 + b1 * q1 + c1 * r1, a1 * p2 + b1 * q2 + c1 * r2
            h20, h21, h22 = a2 * p0 + b2 * q0 + c2 * r0, a2 * p1 + b2 * q1 + c2 * r1, a2 * p2 + b2 * q2 + c2 * r2
            # cof H, tr H, J − 1 = tr H + tr cof H + det H, and cof F = 1 + (tr H 1 − Hᵀ) + cof H
            k00, k01, k02 = h11 * h22 - h12 * h21, h12 * h20 - h10 * h22, h10 * h21 - h11 * h20
            k10, k11, k12 = h21 * h02 - h22 * h01, h22 * h00 - h20 * h02, h20 * h01 - h21 * h00
            k20, k21, k22 = h01 * h12 - h02 * h11, h02 * h10 - h00 * h12, h00 * h11 - h01 * h10
            trace = h00 + h11 + h22
            growth = trace + k00 + k11 + k22 + h00 * k00 + h01 * k01 + h02 * k02
            stiff = mu[e]
            pressure = (lam[e] + stiff) * growth
            push = pressure - stiff
            # P = μ (1 + H) + push (1 + C) with C = cof F − 1; the two unit matrices leave `pressure`.
            s00 = stiff * h00 + push * (trace - h00 + k00) + pressure * one
            s01 = stiff * h01 + push * (k01 - h10)
            s02 = stiff * h02 + push * (k02 - h20)
            s10 = stiff * h10 + push * (k10 - h01)
            s11 = stiff * h11 + push * (trace - h11 + k11) + pressure * one
            s12 = stiff * h12 + push * (k12 - h21)
            s20 = stiff * h20 + push * (k20 - h02)
            s21 = stiff * h21 + push * (k21 - h12)
            s22 = stiff * h22 + push * (trace - h22 + k22) + pressure * one
            v = volume[e]
            f3, f4, f5 = s00 * p0 + s01 * p1 + s02 * p2, s10 * p0 + s11 * p1 + s12 * p2, s20 * p0 + s21 * p1 + s22 * p2
            f6, f7, f8 = s00 * q0 + s01 * q1 + s02 * q2, s10 * q0 + s11 * q1 + s12 * q2, s20 * q0 + s21 * q1 + s22 * q2
            f9, g0, g1 = s00 * r0 + s01 * r1 + s02 * r2, s10 * r0 + s11 * r1 + s12 * r2, s20 * r0 + s21 * r1 + s22 * r2
            out[e, 0], out[e, 1], out[e, 2] = -v * (f3 + f6 + f9), -v * (f4 + f7 + g0), -v * (f5 + f8 + g1)
            out[e, 3], out[e, 4], out[e, 5] = v * f3, v * f4, v * f5
            out[e, 6], out[e, 7], out[e, 8] = v * f6, v * f7, v * f8
            out[e, 9], out[e, 10], out[e, 11] = v * f9, v * g0, v * g1


@njit(parallel=True, fastmath=True, cache=True)
def _sum_at_nodes(offsets: IntArray, entries: Int32Array, forces: Float32Array, out: Float32Array) -> None:
    """Sum the entries of `forces` (4 m, 3) that belong to each node into `out` (n, 3)."""
    n = len(out)
    for chunk in prange(_CHUNKS):
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            x = y = z = np.float32(0.0)
            for k in range(offsets[i], offsets[i + 1]):
                e = entries[k]
                x += forces[e, 0]
                y += forces[e, 1]
                z += forces[e, 2]
            out[i, 0], out[i, 1], out[i, 2] = x, y, z


class Equilibrium:
    """Evaluates the residual on one mesh; keeps work arrays, so that it serves one caller at a time.

    Args:
        mesh: the mesh.
        mu, lam: Lamé constants of each tissue of the mesh [N/mm²], shape (T,).

    Example:
        >>> Equilibrium(mesh, mu=[8.8e-3], lam=[84.7e-3]).residual(field, coordinates).shape
        (15984,)
    """

    def __init__(self, mesh: TissueMesh, *, mu: AnyArray, lam: AnyArray) -> None:
        self.mu, self.lam = np.asarray(mu, dtype=np.float64), np.asarray(lam, dtype=np.float64)
        # Cells that move as a whole with one rigid part, or are held, carry no stress.
        group = np.where(mesh.part > 0, mesh.part.astype(np.int64), np.where(mesh.fixed, -1, 0))[mesh.cells]
        deforms = (group == 0).any(axis=1) | (group != group[:, :1]).any(axis=1)
        self._cells = np.ascontiguousarray(mesh.cells[deforms], dtype=np.int32)
        corners = mesh.points[self._cells]
        edges = corners[:, 1:] - corners[:, :1]
        inverse = np.linalg.inv(edges)  # its columns are G_1, G_2, G_3
        self._gradients = np.ascontiguousarray(inverse.transpose(0, 2, 1).reshape(-1, 9), dtype=np.float32)
        self._volume = (np.abs(np.linalg.det(edges)) / 6.0).astype(np.float32)
        tissue = mesh.tissue[deforms].astype(np.int64)
        self._mu, self._lam = self.mu[tissue].astype(np.float32), self.lam[tissue].astype(np.float32)
        flat = self._cells.ravel()
        counts = np.bincount(flat, minlength=mesh.n_points)
        self._offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self._entries = np.argsort(flat, kind="stable").astype(np.int32)
        self._forces = np.empty((len(self._cells), 12), dtype=np.float32)

    @staticmethod
    def of_materials(mesh: TissueMesh, materials: "Sequence[Material]") -> "Equilibrium":
        """For the materials of a scene, one for each tissue.

        Raises:
            InputError: a material other than the Stable Neo-Hookean without logarithm.
        """
        constants = np.array([
            [getattr(material, "mu", np.nan), getattr(material, "lam", np.nan)] for material in materials
        ])
        for material in materials:
            if type(material).__name__ != "StableNeoHookean":
                raise InputError(
                    "tissue", expected="the energy 'stable' (Stable Neo-Hookean without logarithm)",
                    got=type(material).__name__, fix="use the elastic prior alone, or tissue.energy=stable",
                )
        return Equilibrium(mesh, mu=constants[:, 0], lam=constants[:, 1])

    def nodal_forces(self, field: AnyArray) -> Float32Array:
        """∂E/∂x of every node [N], float32, shape (n, 3), for a displacement field [mm], shape (n, 3)."""
        moved = np.ascontiguousarray(field, dtype=np.float32)
        nodal = np.empty_like(moved)
        _cell_forces(self._cells, moved, self._gradients, self._volume, self._mu, self._lam, self._forces)
        _sum_at_nodes(self._offsets, self._entries, self._forces.reshape(-1, 3), nodal)
        return nodal

    def residual(self, field: AnyArray, coordinates: ReducedCoordinates) -> Float32Array:
        """Unbalanced force on each unknown [N, N mm], float32, shape (D,).

        Args:
            field: displacement that moves the parts rigidly and nothing that is fixed [mm], shape (n, 3).
            coordinates: the unknowns.
        """
        nodal = self.nodal_forces(field)
        out = np.empty(coordinates.size, dtype=np.float32)
        out[: coordinates.n_soft] = nodal[coordinates.free].ravel()
        for k, (nodes, arm) in enumerate(zip(coordinates.parts, coordinates.arms, strict=True)):
            force = nodal[nodes].astype(np.float64)
            moved = arm + field[nodes]
            wrench = out[coordinates.n_soft + 6 * k:][:6]
            wrench[:3] = force.sum(axis=0)
            wrench[3:] = np.cross(moved - moved.mean(axis=0), force).sum(axis=0)
        return out
