"""ElasticCells: energy, nodal gradient and node-pair stiffness of the deformable cells of a mesh."""

from collections.abc import Sequence

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.fem.elements import assembly
from mixpinn.fem.elements.pattern import NodePairs, incidence
from mixpinn.fem.elements.ranges import RangeRunner
from mixpinn.fem.material.hyperelastic import LinearElastic, Material, StableNeoHookean, StableNeoHookeanLog
from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics import given_stress as kernels_given
from mixpinn.physics import linear_tetrahedron as kernels
from mixpinn.physics.projection import project_tangents

_COMPILED: dict[type, int] = {
    StableNeoHookean: kernels.STABLE, StableNeoHookeanLog: kernels.STABLE_LOG, LinearElastic: kernels.LINEAR,
}
_OTHER = len(_COMPILED)


class ElasticCells:
    """Cells with their materials; the built-in materials run compiled, all others through `Material`'s methods.

    Args:
        points: rest positions [mm], shape (n, 3).
        cells: nodes of each cell, ascending (so that a cell's pair a < b is the global pair i < j), shape (m, 4).
        tissue: index into `materials` of each cell, shape (m,).
        materials: one per tissue.
        run: how kernels are spread over threads.
    """

    def __init__(
        self, points: FloatArray, cells: IntArray, tissue: AnyArray, materials: Sequence[Material], run: RangeRunner,
    ) -> None:
        code = np.array([_COMPILED.get(type(m), _OTHER + t) for t, m in enumerate(materials)], dtype=np.int64)
        tissue = np.asarray(tissue, dtype=np.int64)
        # Compiled materials first, then the others one after another, so that each is a slice.
        order = np.argsort(np.where(code < _OTHER, 0, code)[tissue], kind="stable")
        tissue = tissue[order]
        self.cells = np.ascontiguousarray(cells[order])
        self._run, self._rest = run, points
        self._gradients, self._volumes = shape_gradients(points, self.cells)
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
        m = len(self.cells)
        self._energies, self._forces, self._blocks = np.empty(m), np.empty((m, 4, 3)), np.empty((m, 6, 3, 3))

    def energy(self, points: FloatArray) -> float:
        """Elastic energy [N mm] with the nodes at `points` (n, 3)."""
        moved = points - self._rest
        self._run(kernels.cell_energies, self._n_compiled, *self._inputs(moved), self._energies)
        for material, chosen in self._others:
            self._energies[chosen] = material.energy(self._deformation(moved, chosen)) * self._volumes[chosen]
        return float(self._energies.sum())

    def gradient(self, points: FloatArray) -> FloatArray:
        """∂E/∂x of every node [N], shape (n, 3)."""
        moved = points - self._rest
        self._run(kernels.cell_forces, self._n_compiled, *self._inputs(moved), self._forces)
        for material, chosen in self._others:
            stress = np.array(material.gradient(self._deformation(moved, chosen)), dtype=np.float64)
            kernels_given.cell_forces_of_stress(
                0, len(stress), stress, self._gradients[chosen], self._volumes[chosen], self._forces[chosen],
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
        self._run(kernels.cell_blocks, self._n_compiled, *self._inputs(moved), project, self._blocks)
        for material, chosen in self._others:
            tangents = np.array(material.hessian(self._deformation(moved, chosen)), dtype=np.float64)
            if project:
                project_tangents(tangents)
            kernels_given.cell_blocks_of_tangent(
                0, len(tangents), tangents, self._gradients[chosen], self._volumes[chosen], self._blocks[chosen],
            )
        self._run(
            assembly.gather_blocks, len(blocks), pairs.cell_offsets, pairs.cell_entries,
            self._blocks.reshape(-1, 9), blocks.reshape(-1, 9),
        )
        self._run(
            assembly.sum_diagonals, len(diagonals), pairs.offsets, pairs.nodes, pairs.ids, blocks, diagonals,
        )

    def _inputs(self, moved: FloatArray) -> tuple[AnyArray, ...]:
        return self.cells, moved, self._gradients, self._volumes, self._kinds, self._mu, self._lam

    def _deformation(self, moved: FloatArray, chosen: slice) -> FloatArray:
        out = np.empty((chosen.stop - chosen.start, 3, 3))
        kernels.cell_deformations(0, len(out), self.cells[chosen], moved, self._gradients[chosen], out)
        return out
