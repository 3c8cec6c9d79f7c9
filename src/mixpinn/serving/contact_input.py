"""What a prediction is made from: contact displacements as a field or as a list of nodes, checked."""

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array
from mixpinn.base.errors import InputError


def checked_field(contact_displacement: AnyArray, *, n_nodes: int) -> Float32Array:
    """A copy of a contact displacement field [mm], float32, shape (n, 3).

    Raises:
        InputError: another shape, or values that are not finite.
    """
    field = np.asarray(contact_displacement)
    if field.shape != (n_nodes, 3) or field.dtype.kind not in "fiu":
        raise InputError(
            "contact displacement", expected=f"numbers of shape {(n_nodes, 3)}", got=f"{field.dtype} {field.shape}",
            fix="give one row for each node of the model's mesh",
        )
    field = np.array(field, dtype=np.float32)
    if not np.isfinite(field).all():
        raise InputError(
            "contact displacement", expected="finite numbers", got=f"{int((~np.isfinite(field)).sum())} others",
            fix="leave out contact nodes whose displacement is unknown",
        )
    return field


def contact_field(nodes: AnyArray, displacements: AnyArray, *, n_nodes: int) -> Float32Array:
    """Spread a list of contact nodes over the mesh: their displacement, zero elsewhere [mm], float32, shape (n, 3).

    Args:
        nodes: ids of the contact nodes, each once, shape (c,).
        displacements: displacement of each of them [mm], shape (c, 3).
        n_nodes: number n of mesh nodes.

    Raises:
        InputError: unknown or repeated nodes, another shape, or values that are not finite.
    """
    nodes, displacements = np.asarray(nodes), np.asarray(displacements)
    if nodes.ndim != 1 or len(nodes) == 0 or nodes.dtype.kind not in "iu":
        raise InputError(
            "contact nodes", expected="a list of at least one node id", got=f"{nodes.dtype} of shape {nodes.shape}",
            fix="list the ids of the mesh nodes that the probe moves",
        )
    if displacements.shape != (len(nodes), 3) or displacements.dtype.kind not in "fiu":
        raise InputError(
            "contact displacements", expected=f"numbers of shape ({len(nodes)}, 3), one row a contact node",
            got=f"{displacements.dtype} of shape {displacements.shape}", fix="give x, y, z of each contact node [mm]",
        )
    unknown = nodes[(nodes < 0) | (nodes >= n_nodes)]
    if len(unknown):
        raise InputError(
            "contact nodes", expected=f"ids from 0 to {n_nodes - 1}", got=f"{unknown[:5].tolist()}",
            fix="use the node numbers of the model's mesh.vtu",
        )
    ids, counts = np.unique(nodes, return_counts=True)
    if (counts > 1).any():
        raise InputError(
            "contact nodes", expected="each node once", got=f"{ids[counts > 1][:5].tolist()} repeatedly",
            fix="keep one row for each node",
        )
    wrong = int((~np.isfinite(displacements)).sum())
    if wrong:
        raise InputError(
            "contact displacements", expected="finite numbers", got=f"{wrong} others",
            fix="leave out contact nodes whose displacement is unknown",
        )
    field = np.zeros((n_nodes, 3), dtype=np.float32)
    field[nodes] = displacements
    return field
