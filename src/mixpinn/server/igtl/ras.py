"""The patient's RAS frame, in which everything leaves and arrives: the image's own, whatever its affine."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.geometry.rotations import orthonormalise
from mixpinn.records import TissueMesh
from mixpinn.server.igtl.damaged import DamagedMessage
from mixpinn.server.igtl.transform import rigid_matrix

_ROUNDING = 1e-2
"""How far a tracked matrix may be from a rotation: that of 32-bit numbers and of trackers, not of a scaled one."""


@dataclass(frozen=True, eq=False)
class RasFrame:
    """Between the world frame of a mesh and the image's RAS frame, both in mm.

    Attributes:
        from_world: world to RAS, a rotation and a shift, shape (4, 4).
    """

    from_world: FloatArray

    @staticmethod
    def of_mesh(mesh: TissueMesh) -> "RasFrame":
        """The frame of the image that the mesh was made of."""
        return RasFrame(np.asarray(mesh.world_to_scanner, dtype=np.float64))

    @property
    def known(self) -> bool:
        """Whether the mesh says where the image was; one that was imported without an image lies at its own origin."""
        return bool(np.any(self.from_world[:3, 3]))

    def points(self, world: AnyArray) -> FloatArray:
        """Points in RAS [mm], shape (n, 3)."""
        return np.asarray(world, dtype=np.float64) @ self.from_world[:3, :3].T + self.from_world[:3, 3]

    def vectors(self, world: AnyArray) -> FloatArray:
        """Displacements, forces or moments in RAS, shape (..., 3)."""
        return np.asarray(world, dtype=np.float64) @ self.from_world[:3, :3].T

    def motion(self, matrix: AnyArray) -> FloatArray:
        """What carries rigid parts from where the image shows them to where they are now: W T W⁻¹, shape (..., 4, 4).

        Args:
            matrix: T, the same in the world, as `serving.motions.motion_matrices` makes it, shape (..., 4, 4).
        """
        return self.from_world @ np.asarray(matrix, dtype=np.float64) @ np.linalg.inv(self.from_world)

    def probe_to_world(self, matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and tip (3,) [mm] in the world of a probe that was tracked in RAS.

        Args:
            matrix: from the probe's own frame, tip at the origin and pointing to −y, to RAS, shape (4, 4).

        Raises:
            DamagedMessage: the matrix is no rigid placement.
        """
        turn = self.from_world[:3, :3].T @ matrix[:3, :3]
        if np.abs(turn @ turn.T - np.eye(3)).max() > _ROUNDING or np.linalg.det(turn) < 0.0:
            raise DamagedMessage("the probe's transform is no rigid placement: it scales, shears or mirrors")
        tip = self.from_world[:3, :3].T @ (matrix[:3, 3] - self.from_world[:3, 3])
        return orthonormalise(turn), tip

    def probe_from_world(self, rotation: AnyArray, tip: AnyArray) -> FloatArray:
        """The matrix that `probe_to_world` reads, shape (4, 4)."""
        return self.from_world @ rigid_matrix(rotation, tip)
