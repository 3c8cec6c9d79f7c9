"""Joint frames from the anatomy.

Of vertebrae the centre lies between neighbouring end plates, and the axes come from the bodies' own shape. The joint
of a hip and the sacrum has the axes of the sacrum's upper end plate and lies in the middle of it, as the figures
of its preset were measured. That of a rib and its vertebra lies where the two are nearest, with the axes of the world.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

from mixpinn.anatomy.articulations import are_costovertebral, are_sacroiliac, articulating
from mixpinn.anatomy.names import spine_rank
from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.records.joint_frame import JointFrame
from mixpinn.records.tissue_mesh import TissueMesh

_FACING = np.cos(np.deg2rad(40.0))
"""Faces of an end plate, or of the wall before the canal, look within 40° of its axis."""
_FRONT = 0.3
"""Part of a vertebra's reach from front to back that is body alone in every lumbar and thoracic vertebra."""
_CANAL = 8.0
"""The canal is sought within so many millimetres of the vertebra's middle plane."""
_SACRAL = 300
_WIDEST = 25.0
"""A rib whose nearest face is farther from its vertebra is not joined to it [mm]: its head is not among the maps."""
_RIGHT, _BACK = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, eq=False)
class BoneSurface:
    """The surface of one vertebra, face by face.

    Attributes:
        centres: of the faces [mm], shape (f, 3).
        areas: normals out of the bone, as long as the faces are large [mm²], shape (f, 3).
    """

    centres: FloatArray
    areas: FloatArray

    @staticmethod
    def of_part(mesh: TissueMesh, k: int) -> "BoneSurface":
        """Surface of rigid part k (1 … K): the cavity's faces, whose normals point into the bone, turned round.

        Raises:
            InputError: the part is no cavity.
        """
        faces = mesh.boundary_faces
        chosen = faces[(mesh.part[faces] == k).all(axis=1)]
        if not len(chosen):
            raise InputError(
                mesh.rigid_names[k - 1], expected="a bone whose surface is a cavity of the mesh", got="no such faces",
                fix="make the mesh from label maps, or give the joint's frame yourself (JointFrame)",
            )
        a, b, c = np.moveaxis(mesh.points[chosen], 1, 0)
        return BoneSurface((a + b + c) / 3.0, -0.5 * np.cross(b - a, c - a))

    @property
    def sizes(self) -> FloatArray:
        """Areas [mm²], shape (f,)."""
        return np.linalg.norm(self.areas, axis=1)

    @property
    def middle(self) -> FloatArray:
        """Centre of the surface [mm], shape (3,)."""
        return self.centre_of(np.ones(len(self.centres), dtype=bool))

    def centre_of(self, chosen: FloatArray) -> FloatArray:
        """Centre of some faces [mm], shape (3,)."""
        centre: FloatArray = np.average(self.centres[chosen], axis=0, weights=self.sizes[chosen])
        return centre

    def end_plate(self, way: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Centre [mm] and normal of the end plate that looks along the unit vector `way`; shapes (3,), (3,).

        The vertebral body reaches from the bone's front to the wall before the canal: the faces near the middle plane
        that look backward and are not the processes'. Its end plate are the faces on the side of `way` that look
        along it; their normal is the sum of their area vectors, that of the plane of the rim, however hollow they are.

        Raises:
            ValueError: there are none.
        """
        back = _unit(_BACK - (_BACK @ way) * way)
        side = np.cross(back, way)
        reach, height, facing = self.centres @ back, self.centres @ way, self.areas / self.sizes[:, None]
        first, length = reach.min(), np.ptp(reach)
        wall = (facing @ back >= _FACING) & (np.abs((self.centres - self.middle) @ side) <= _CANAL)
        wall &= (reach >= first + 0.8 * _FRONT * length) & (reach <= first + 2.0 * _FRONT * length)
        depth = np.average(reach[wall], weights=self.sizes[wall]) if wall.any() else first + _FRONT * length
        body = reach <= depth
        plate = body & (facing @ way >= _FACING)
        plate &= height >= 0.5 * (height[body].min() + height[body].max())
        if not plate.any():
            raise ValueError("no face of the body looks along the spine")
        return self.centre_of(plate), _unit(self.areas[plate].sum(axis=0))


def joint_frames(mesh: TissueMesh, *, between: Sequence[tuple[str, str]] | None = None) -> tuple[JointFrame, ...]:
    """Frames of the joints between bones.

    Of two vertebrae, the origin lies halfway between the centres of the two facing end plates. z is the mean of their
    normals, caudal; y points from the end plates to the middle of both surfaces, which the processes draw to the back,
    orthogonal to z; x = y × z to the right.

    Args:
        mesh: a mesh whose vertebrae are cavities, in the world frame.
        between: pairs of parts, of vertebrae (caudal, cranial); by default `neighbours`.

    Returns:
        One frame a joint, in the order of the pairs.

    Raises:
        InputError: a part that the mesh does not have, whose end plates are not found, or a rib far from its vertebra.
    """
    between = neighbours(mesh) if between is None else between
    return tuple(_frame_of(mesh, first, second) for first, second in between)


def neighbours(mesh: TissueMesh) -> tuple[tuple[str, str], ...]:
    """Bones that articulate.

    Vertebrae that follow each other along the spine, caudal and cranial, from head to foot; then hips with the sacrum,
    and vertebrae with their ribs.
    """
    ranked = sorted((rank, name) for name in mesh.rigid_names if (rank := spine_rank(name)) is not None)
    return (*((lower, upper) for (_, upper), (_, lower) in pairwise(ranked)), *articulating(mesh.rigid_names))


def _frame_of(mesh: TissueMesh, first: str, second: str) -> JointFrame:
    if are_sacroiliac(first, second):
        return _sacroiliac(mesh, first, second)
    return _costovertebral(mesh, first, second) if are_costovertebral(first, second) else _frame(mesh, first, second)


def _sacroiliac(mesh: TissueMesh, first: str, second: str) -> JointFrame:
    _surface(mesh, first)
    sacrum = _surface(mesh, second)
    try:
        # The end plate looks up and to the front; straight up first, then along what was found.
        _, up = sacrum.end_plate(np.array([0.0, 0.0, -1.0]))
        _, up = sacrum.end_plate(up)
    except ValueError as error:
        raise InputError(
            f"joint of {second} and {first}", expected="the upper end plate of the sacrum", got=str(error),
            fix="give the joint's frame yourself (JointFrame, joint_frames=FILE), or do without joints (--joints none)",
        ) from error
    back = _unit(_BACK - (_BACK @ up) * up)
    axes = np.stack([np.cross(back, -up), back, -up])
    return JointFrame.of_arrays(first, second, origin=sacrum.middle, axes=axes)


def _costovertebral(mesh: TissueMesh, first: str, second: str) -> JointFrame:
    bone, rib = (_surface(mesh, name).centres for name in (first, second))
    apart, nearest = KDTree(bone).query(rib)
    if apart.min() > _WIDEST:
        raise InputError(
            f"joint of {second} and {first}", expected=f"a rib no farther than {_WIDEST:g} mm from its vertebra",
            got=f"{apart.min():.0f} mm", fix="give the joint's frame yourself (JointFrame, joint_frames=FILE)",
        )
    head = int(apart.argmin())
    return JointFrame.of_arrays(first, second, origin=0.5 * (rib[head] + bone[nearest[head]]), axes=np.eye(3))


def _frame(mesh: TissueMesh, first: str, second: str) -> JointFrame:
    lower, upper = (_surface(mesh, name) for name in (first, second))
    caudal = _unit(lower.middle - upper.middle)
    try:
        for _ in range(2):  # the direction of the spine here, from where the bones are and then from the end plates
            below, up = lower.end_plate(-caudal)
            above, down = upper.end_plate(caudal)
            caudal = _unit(down - up)
        halves = [0.5 * np.linalg.norm(upper.end_plate(-caudal)[0] - above)]
        if (spine_rank(first) or 0) < _SACRAL:
            halves.append(0.5 * np.linalg.norm(lower.end_plate(caudal)[0] - below))
    except ValueError as error:
        raise InputError(
            f"joint of {second} and {first}", expected="facing end plates", got=str(error),
            fix="give the joint's frame yourself (JointFrame, joint_frames=FILE), or do without joints (--joints none)",
        ) from error
    origin = 0.5 * (above + below)
    behind = 0.5 * (lower.middle + upper.middle) - origin
    back = _unit(behind - (behind @ caudal) * caudal)
    axes = np.stack([np.cross(back, caudal), back, caudal])
    # Of the sacrum, one bone of many segments, the half that belongs to the joint is taken as that of the other body.
    spacing = float(np.linalg.norm(above - below)) + float(halves[0] + halves[-1])
    return JointFrame.of_arrays(first, second, origin=origin, axes=axes, spacing=spacing)


def _surface(mesh: TissueMesh, name: str) -> BoneSurface:
    if name not in mesh.rigid_names:
        raise InputError(
            "joint frames", expected="rigid parts of the mesh: " + (", ".join(mesh.rigid_names) or "none"),
            got=repr(name), fix="name two parts that the mesh has",
        )
    return BoneSurface.of_part(mesh, mesh.rigid_names.index(name) + 1)


def _unit(vector: FloatArray) -> FloatArray:
    unit: FloatArray = vector / np.linalg.norm(vector)
    return unit
