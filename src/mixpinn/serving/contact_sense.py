"""Whether a list of contact nodes can be what a probe does: skin that is free to move, displacements and not places."""

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh

_FAR, _METRES = 20.0, 0.02
"""Displacements beyond the first [mm] may be places; all below the second they may be metres."""


def check_contacts(mesh: TissueMesh, nodes: AnyArray, displacements: AnyArray, *, what: str) -> None:
    """Refuse contacts that no probe makes. What has another shape is left to the predictor.

    Args:
        mesh: the model's mesh.
        nodes: ids of the contact nodes, shape (c,).
        displacements: of each of them [mm], shape (c, 3).
        what: where they come from, for messages.

    Raises:
        InputError: nodes that are not of the skin or are fixed, places of the nodes instead of their displacement, or
            lengths in metres.
    """
    nodes, displacements = np.asarray(nodes), np.asarray(displacements)
    if nodes.ndim != 1 or displacements.shape != (len(nodes), 3) or nodes.dtype.kind not in "iu" or not len(nodes):
        return
    if displacements.dtype.kind not in "fiu" or not np.isfinite(displacements).all():
        return
    if nodes.min() < 0 or nodes.max() >= mesh.n_points:
        return
    skin = np.zeros(mesh.n_points, dtype=bool)
    skin[mesh.skin_faces] = True
    for wrong, kind in ((~skin[nodes], "inside the body or of a rigid part"), (mesh.fixed[nodes], "fixed")):
        if wrong.any():
            raise InputError(
                what, expected="free nodes of the skin", got=f"nodes {kind}: {nodes[wrong][:5].tolist()}",
                fix="use the node numbers of the model's mesh.vtu, which begin at 0",
            )
    moved = np.linalg.norm(displacements, axis=1)
    to_place = np.linalg.norm(displacements - mesh.points[nodes], axis=1)
    if moved.max() > _FAR and (to_place < 0.5 * moved).all():
        raise InputError(
            what, expected="displacements of the contact nodes [mm]", got="what looks like their places",
            fix="subtract the places of the nodes at rest",
        )
    if 0.0 < moved.max() < _METRES:
        raise InputError(
            what, expected="displacements in mm", got=f"at most {moved.max():.2g}: they look like metres",
            fix="give the displacements in mm",
        )
