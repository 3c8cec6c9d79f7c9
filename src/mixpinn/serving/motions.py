"""Motions of the rigid parts, by name: from the reduced unknowns of a model, or read off a displacement field."""

from collections.abc import Mapping

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.geometry.rigid_fit import fit_rotation
from mixpinn.geometry.rotations import rotation_from_vector, vector_from_rotation
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Motion


def motions_of_twists(mesh: TissueMesh, twists: FloatArray) -> dict[str, Motion]:
    """Motions from translations of the centroids [mm] and rotation vectors [rad] of all parts, shape (K, 6)."""
    values = np.asarray(twists, dtype=np.float64).reshape(-1, 6)
    return {
        name: Motion(twist[:3], twist[3:], rotation)
        for name, twist, rotation in zip(mesh.rigid_names, values, rotation_from_vector(values[:, 3:]), strict=True)
    }


def motions_of_field(mesh: TissueMesh, displacement: AnyArray) -> dict[str, Motion]:
    """The rigid motion of each part that is nearest to a field [mm], shape (n, 3), by least squares."""
    motions = {}
    for k, name in enumerate(mesh.rigid_names, start=1):
        rest = mesh.points[mesh.part_nodes(k)]
        moved = rest + np.asarray(displacement, dtype=np.float64)[mesh.part_nodes(k)]
        rotation = fit_rotation(rest, moved)
        motions[name] = Motion((moved - rest).mean(axis=0), vector_from_rotation(rotation), rotation)
    return motions


def centroids(mesh: TissueMesh) -> FloatArray:
    """Mean of the vertices of each rigid part at rest [mm], shape (K, 3)."""
    centres = [mesh.points[mesh.part_nodes(k + 1)].mean(axis=0) for k in range(mesh.n_parts)]
    return np.array(centres, dtype=np.float64).reshape(-1, 3)


def motion_matrices(
    mesh: TissueMesh, motions: Mapping[str, Motion], *, centres: FloatArray | None = None,
) -> FloatArray:
    """Where each rigid part went, as matrices from its place at rest [mm], shape (K, 4, 4).

    x → R (x − c) + c + t, with c the mean of the part's vertices at rest; a part without a motion stays.

    Args:
        mesh: whose parts they are.
        motions: by name.
        centres: what `centroids` found [mm], shape (K, 3); for who asks often.
    """
    centres = centroids(mesh) if centres is None else centres
    matrices = np.tile(np.eye(4), (mesh.n_parts, 1, 1))
    for k, name in enumerate(mesh.rigid_names):
        if name in motions:
            motion, centre = motions[name], centres[k]
            matrices[k, :3, :3] = motion.rotation
            matrices[k, :3, 3] = centre + motion.translation - motion.rotation @ centre
    return matrices
