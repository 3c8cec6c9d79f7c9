"""ElasticCells: energy, nodal gradient and node-pair stiffness of the deformable cells of a mesh."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.fem.elements import assembly
from mixpinn.fem.elements.pattern import NodePairs, incidence
from mixpinn.fem.elements.ranges import RangeRunner
from mixpinn.fem.material.hyperelastic import LinearElastic, Material, StableNeoHookean, StableNeoHookeanLog
from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics import energies, given_stress, linear_tetrahedron, quadratic_tetrahedron
from mixpinn.physics.projection import project_tangents
from mixpinn.physics.quadrature import TETRAHEDRON_4, Quadrature

_COMPILED: dict[type, int] = {
    StableNeoHookean: energies.STABLE, StableNeoHookeanLog: energies.STABLE_LOG, LinearElastic: energies.LINEAR,
}
_OTHER = len(_COMPILED)


class ElasticCells:
    """Cells with their materials; the built-in materials run compiled, all others through `Material`'s methods.

    Args:
        points: rest positions [mm], shape (n, 3).
        cells: nodes of each cell, ascending (so that a cell's pair a < b is the global pair i < j), shape (m, 4) or
            (m, 10); ten nodes are four vertices and the midpoints of `mixpinn.physics.energies.LOCAL_PAIRS`.
        tissue: index into `materials` of each cell, shape (m,).
        materials: one per tissue.
        run: how kernels are spread over threads.
        quadrature: of ten-node cells.
    """

    def __init__(
        self, points: FloatArray, cells: IntArray, tissue: AnyArray, materials: Sequence[Material], run: RangeRunner, *,
        quadrature: Quadrature = TETRAHEDRON_4,
    ) -> None:
        code = np.array([_COMPILED.get(type(m), _OTHER + t) for t, m in enumerate(materials)], dtype=np.int64)
        tissue = np.asarray(tissue, dtype=np.int64)
        # Compiled materials first, then the others one after another, so that each is a slice.
        order = np.argsort(np.where(code < _OTHER, 0, code)[tissue], kind="stable")
        tissue = tissue[order]
        self.cells = np.ascontiguousarray(cells[order])
        self._run, self._rest = run, points
        gradients, volumes = shape_gradients(points, self.cells[:, :4])
        m, v = self.cells.shape
        self._quadratic = v == 10
        self._kernels: Any = quadratic_tetrahedron if self._quadratic else linear_tetrahedron
        self._of_cell = (gradients, volumes)
        self._rule: tuple[FloatArray, ...] = (quadrature.points, quadrature.weights) if self._quadratic else ()
        self._kinds = code[tissue]
        self._n_compiled = int(np.count_nonzero(self._kinds < _OTHER))
        self._others: list[tuple[Material, slice]] = []
        for c, material in zip(code, materials, strict=True):
            found = np.flatnonzero(self._kinds == c)
            if c >= _OTHER and len(found):
                self._others.append((material, slice(int(found[0]), int(found[-1]) + 1)))
        # Other materials have constants of their own, which the kernels do not read.
        self._mu = np.array([getattr(m, "mu", 0.0) if type(m) in _COMPILED else 0.0 for m in materials])[tissue]
        self._lam = np.array([getattr(m, "lam", 0.0) if type(m) in _COMPILED else 0.0 for m in materials])[tissue]
        self._offsets, self._entries = incidence(self.cells.ravel(), len(points))
        self._energies, self._forces = np.empty(m), np.empty((m, v, 3))
        self._blocks = np.empty((m, v * (v - 1) // 2, 3, 3))

    def energy(self, points: FloatArray) -> float:
        """Elastic energy [N mm] with the nodes at `points` (n, 3)."""
        moved = points - self._rest
        self._run(self._kernels.cell_energies, self._n_compiled, *self._inputs(moved), self._energies)
        shares = self._rule[1] if self._quadratic else np.ones(1)
        for material, chosen in self._others:
            density = material.energy(self._deformation(moved, chosen)).reshape(-1, len(shares))
            self._energies[chosen] = density @ shares * self._of_cell[1][chosen]
        return float(self._energies.sum())

    def gradient(self, points: FloatArray) -> FloatArray:
        """∂E/∂x of every node [N], shape (n, 3)."""
        moved = points - self._rest
        self._run(self._kernels.cell_forces, self._n_compiled, *self._inputs(moved), self._forces)
        for material, chosen in self._others:
            stress = np.array(material.gradient(self._deformation(moved, chosen)), dtype=np.float64)
            self._from_given(
                given_stress.quadratic_forces_of_stress if self._quadratic else given_stress.cell_forces_of_stress,
                chosen, stress, self._forces,
            )
        nodal = np.empty_like(points)
        self._run(
            assembly.gather_forces, len(nodal), self._offsets, self._entries, self._forces.reshape(-1, 3), nodal,
        )
        return nodal

    def stiffness(
        self, points: FloatArray, pairs: NodePairs, project: bool, blocks: FloatArray, diagonals: FloatArray,
    ) -> None:
        """∂²E/∂x_i ∂x_j [N/mm] of the pairs i < j into `blocks` (p, 3, 3) and of i = j into `diagonals` (n, 3, 3)."""
        moved = points - self._rest
        self._run(self._kernels.cell_blocks, self._n_compiled, *self._inputs(moved), project, self._blocks)
        for material, chosen in self._others:
            tangents = np.array(material.hessian(self._deformation(moved, chosen)), dtype=np.float64)
            if project:
                project_tangents(tangents)
            self._from_given(
                given_stress.quadratic_blocks_of_tangent if self._quadratic else given_stress.cell_blocks_of_tangent,
                chosen, tangents, self._blocks,
            )
        self._run(
            assembly.gather_blocks, len(blocks), pairs.cell_offsets, pairs.cell_entries,
            self._blocks.reshape(-1, 9), blocks.reshape(-1, 9),
        )
        self._run(
            assembly.sum_diagonals, len(diagonals), pairs.offsets, pairs.nodes, pairs.ids, blocks, diagonals,
        )

    def _inputs(self, moved: FloatArray) -> tuple[AnyArray, ...]:
        return self.cells, moved, *self._of_cell, *self._rule, self._kinds, self._mu, self._lam

    def _deformation(self, moved: FloatArray, chosen: slice) -> FloatArray:
        """F at the points of some cells, cell by cell, shape (k, 3, 3)."""
        count, places = chosen.stop - chosen.start, self._rule[:1]
        out = np.empty((count, len(places[0]), 3, 3) if self._quadratic else (count, 3, 3))
        self._kernels.cell_deformations(
            0, count, self.cells[chosen], moved, self._of_cell[0][chosen], *places, out,
        )
        return out.reshape(-1, 3, 3)

    def _from_given(self, kernel: Callable[..., None], chosen: slice, given: FloatArray, out: FloatArray) -> None:
        """Forces or blocks of some cells from stresses or tangents at their points, cell by cell."""
        count = chosen.stop - chosen.start
        if self._quadratic:
            given = given.reshape(count, -1, *given.shape[1:])
        kernel(0, count, given, *(values[chosen] for values in self._of_cell), *self._rule, out[chosen])
