"""The equilibrium residual of a displacement field, in single precision and fast enough for every prediction.

What the finite-element solver drives to zero, evaluated for a predicted state: nodal forces of the Stable Neo-Hookean
material (`mixpinn.physics.single_precision`), gathered on the unknowns of `ReducedCoordinates`, where each rigid part
has a net force and a moment about its current centroid. Single precision leaves about 1e-6 of the forces in a cell, far
less than the error of a prediction.
"""

from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, Int32Array
from mixpinn.base.errors import InputError
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics.foundation import FoundationSystem
from mixpinn.physics.joint_system import JointSystem
from mixpinn.physics.membrane import MembraneSystem
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.physics.single_precision import add_quadratic_stable_forces, add_stable_forces, in_lanes
from mixpinn.records import TissueMesh
from mixpinn.reduced.coordinates import ReducedCoordinates

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mixpinn.fem import Material


class Equilibrium:
    """Evaluates the residual on one mesh; an evaluation changes nothing, so that threads may share an instance.

    Args:
        mesh: the mesh.
        mu, lam: Lamé constants of each tissue of the mesh [N/mm²], shape (T,).
        restraints: joints, foundations and membrane, which are evaluated in double precision.

    Example:
        >>> coordinates = ReducedCoordinates(mesh)
        >>> equilibrium = Equilibrium(mesh, mu=[8.8e-3], lam=[84.7e-3])
        >>> residual = equilibrium.residual(np.zeros(coordinates.size, dtype=np.float32), coordinates)
        >>> bool(np.abs(residual).max() < 1e-4)  # at rest no force is left [N]
        True
    """

    def __init__(
        self, mesh: TissueMesh, *, mu: AnyArray, lam: AnyArray, restraints: Restraints = FREE,
    ) -> None:
        self.mu, self.lam = np.asarray(mu, dtype=np.float64), np.asarray(lam, dtype=np.float64)
        self._quadratic = mesh.order == 2
        self._cells, self._gradients, self._constants = map(in_lanes, cell_arrays(mesh, self.mu, self.lam))
        self.restraints = restraints
        self._centroids = [mesh.points[mesh.part_nodes(k)].mean(axis=0) for k in range(1, mesh.n_parts + 1)]
        self.joints = JointSystem(restraints.joints, mesh.rigid_names, np.array(self._centroids).reshape(-1, 3))
        self._under = [
            system for system in (
                FoundationSystem(restraints.foundations, mesh), MembraneSystem(restraints.membrane, mesh),
            ) if len(system)
        ]

    @staticmethod
    def of_materials(
        mesh: TissueMesh, materials: "Sequence[Material]", restraints: Restraints = FREE,
    ) -> "Equilibrium":
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
        return Equilibrium(mesh, mu=constants[:, 0], lam=constants[:, 1], restraints=restraints)

    @property
    def rests_on_skin(self) -> bool:
        """Whether foundations or a membrane act on the skin."""
        return bool(self._under)

    def joints_at_rest(self) -> tuple[FloatArray, FloatArray]:
        """Wrenches of the joints at rest [N, N mm], shape (K, 6), and their stiffness there, shape (6 K, 6 K)."""
        count = len(self._centroids)
        turns, shifts = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        stiffness = np.zeros((6 * count, 6 * count))
        self.joints.add_tangent(turns, shifts, stiffness)
        return self.joints.gradient(turns, shifts), stiffness

    def nodal_forces(self, field: AnyArray) -> Float32Array:
        """∂E/∂x of every node [N], float32, shape (n, 3), for a displacement field [mm], shape (n, 3)."""
        moved = np.ascontiguousarray(field, dtype=np.float32)
        nodal = np.zeros_like(moved)
        add = add_quadratic_stable_forces if self._quadratic else add_stable_forces
        add(self._cells, moved, self._gradients, self._constants, nodal)
        for under in self._under:
            under.add_forces(moved, nodal)
        return nodal

    def residual(self, unknowns: AnyArray, coordinates: ReducedCoordinates) -> Float32Array:
        """Unbalanced force on each unknown [N, N mm], float32, shape (D,).

        Args:
            unknowns: the state [mm, rad], shape (D,).
            coordinates: the unknowns.
        """
        field = coordinates.expand(unknowns)
        nodal = self.nodal_forces(field)
        out = coordinates.gather(nodal, field)
        if len(self.joints):
            twists = coordinates.twists(unknowns)
            wrenches = self.joints.gradient(rotation_from_vector(twists[:, 3:]), twists[:, :3])
            out[coordinates.n_soft:] += wrenches.ravel().astype(np.float32)
        if coordinates.held.any():
            out[coordinates.n_soft:].reshape(-1, 6)[coordinates.held] = 0.0
        return out


def cell_arrays(mesh: TissueMesh, mu: FloatArray, lam: FloatArray) -> tuple[Int32Array, Float32Array, Float32Array]:
    """What the kernels need of each cell that deforms: nodes, gradients and constants, m rows each.

    Args:
        mesh: the mesh.
        mu, lam: Lamé constants of each tissue [N/mm²], shape (T,).
    """
    deforms = mesh.deforming_cells  # no other cell carries stress
    # Sorted, ten nodes are four vertices and the midpoints of their pairs in ascending order.
    cells = (mesh.cells if mesh.order == 1 else np.sort(mesh.cell_nodes, axis=1))[deforms]
    gradients, volumes = shape_gradients(mesh.points, cells[:, :4])
    tissue = mesh.tissue[deforms].astype(np.int64)
    constants = np.stack([mu[tissue], lam[tissue], volumes], axis=1)
    return (
        cells.astype(np.int32), gradients[:, 1:].reshape(-1, 9).astype(np.float32), constants.astype(np.float32),
    )
