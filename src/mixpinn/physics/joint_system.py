"""Joints between the rigid parts of a mesh: their energy, wrenches and tangent on the parts' unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.physics.joint_kernel import motions_and_gradients
from mixpinn.physics.joint_motion import CarriedFrame, motion_curvature
from mixpinn.physics.joints import JointLaw
from mixpinn.records.joint_frame import JointFrame


@dataclass(frozen=True)
class Joint:
    """A law between two rigid parts.

    Attributes:
        frame: the parts by name, and where and along which axes the law acts.
        law: elastic law of the relative motion.
    """

    frame: JointFrame
    law: JointLaw


class JointSystem:
    """All joints of a mesh as a function of the poses of its rigid parts.

    Args:
        joints: the joints.
        names: names of the rigid parts 1 … K.
        centroids: rest centroids of the parts, about which they turn [mm], shape (K, 3).

    Raises:
        InputError: a joint of a part that the mesh does not have.
    """

    def __init__(self, joints: Sequence[Joint], names: Sequence[str], centroids: FloatArray) -> None:
        known = {name: k for k, name in enumerate(names)}
        listed = ", ".join(names) or "none"
        for joint in joints:
            for name in (joint.frame.first, joint.frame.second):
                if name not in known:
                    raise InputError(
                        f"joint {joint.frame.name}", expected=f"rigid parts of the mesh: {listed}",
                        got=repr(name), fix="leave the joint out, or make the mesh with this part rigid",
                    )
        self.joints = tuple(joints)
        self._pairs = [(known[joint.frame.first], known[joint.frame.second]) for joint in joints]
        self._centroids = np.ascontiguousarray(centroids, dtype=np.float64)
        self._index = np.array(self._pairs, dtype=np.int64).reshape(-1, 2)
        self._origins = np.array([joint.frame.origin for joint in joints]).reshape(-1, 3)
        self._columns = np.array([joint.frame.columns for joint in joints]).reshape(-1, 3, 3)

    def __len__(self) -> int:
        return len(self.joints)

    def motions(self, rotation: FloatArray, translation: FloatArray) -> FloatArray:
        """Relative motion q of each joint [mm, rad], shape (j, 6).

        Args:
            rotation: of the parts, shape (K, 3, 3).
            translation: of their centroids [mm], shape (K, 3).
        """
        return self._motions_and_gradients(rotation, translation)[0]

    def energy(self, rotation: FloatArray, translation: FloatArray) -> float:
        """Sum of the joints' energies [N mm]; operands as in `motions`."""
        motions = self.motions(rotation, translation)
        return float(sum(joint.law.energy(q) for joint, q in zip(self.joints, motions, strict=True)))

    def gradient(self, rotation: FloatArray, translation: FloatArray) -> FloatArray:
        """Derivative of the energy by the twist of each part about its centroid [N, N mm], shape (K, 6)."""
        gradient = np.zeros((len(self._centroids), 6))
        motions, rates = self._motions_and_gradients(rotation, translation)
        for joint, (first, second), motion, rate in zip(self.joints, self._pairs, motions, rates, strict=True):
            both = joint.law.wrench(motion) @ rate
            gradient[first] += both[:6]
            gradient[second] += both[6:]
        return gradient

    def _motions_and_gradients(self, rotation: FloatArray, translation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """q of each joint, shape (j, 6), and its derivative by the twists of its two parts, shape (j, 6, 12)."""
        motions, gradients = np.empty((len(self), 6)), np.empty((len(self), 6, 12))
        motions_and_gradients(
            np.ascontiguousarray(rotation), np.ascontiguousarray(translation), self._centroids, self._index,
            self._origins, self._columns, motions, gradients,
        )
        return motions, gradients

    def add_tangent(
        self, rotation: FloatArray, translation: FloatArray, dense: FloatArray, *, project: bool = False,
    ) -> None:
        """Add the Hessian by all twists, for R ← exp([δw]) R, in place.

        Args:
            rotation, translation: as in `motions`.
            dense: rows and columns of the parts' twists, shape (6K, 6K).
            project: lift negative eigenvalues of each joint's share to zero.
        """
        motions, rates = self._motions_and_gradients(rotation, translation)
        for j, (joint, motion, rate) in enumerate(zip(self.joints, motions, rates, strict=True)):
            tangent = rate.T @ joint.law.tangent(motion) @ rate
            tangent += motion_curvature(*self._carried(j, rotation, translation), joint.law.wrench(motion))
            if project:
                values, vectors = np.linalg.eigh(tangent)
                tangent = (vectors * np.maximum(values, 0.0)) @ vectors.T
            unknowns = np.concatenate([6 * k + np.arange(6) for k in self._pairs[j]])
            dense[np.ix_(unknowns, unknowns)] += tangent

    def _carried(
        self, j: int, rotation: FloatArray, translation: FloatArray,
    ) -> tuple[CarriedFrame, CarriedFrame]:
        frame = self.joints[j].frame
        first, second = (
            CarriedFrame(
                rotation[k] @ frame.columns, rotation[k] @ (frame.centre - self._centroids[k]),
                self._centroids[k] + translation[k],
            ) for k in self._pairs[j]
        )
        return first, second
