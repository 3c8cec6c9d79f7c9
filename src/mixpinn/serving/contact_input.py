"""What a prediction is made from: the contact nodes and their displacement, checked."""

from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, IntArray
from mixpinn.base.errors import InputError

if TYPE_CHECKING:
    from mixpinn.press.records import ContactHistory

_LARGEST = 1000.0
"""Displacement that no skin has [mm]; far beyond it single precision has no numbers left."""


def checked_contact(nodes: AnyArray, displacements: AnyArray, *, n_nodes: int) -> tuple[IntArray, Float32Array]:
    """Contact nodes in ascending order, shape (c,), and the displacement of each [mm], float32, shape (c, 3).

    Nodes that are held at exactly zero are contact nodes like any other.

    Args:
        nodes: ids of the contact nodes, each once, shape (c,).
        displacements: displacement of each of them [mm], shape (c, 3).
        n_nodes: number n of mesh nodes.

    Raises:
        InputError: unknown or repeated nodes, another shape, or values that are not finite or beyond any body.
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
    order = np.argsort(nodes, kind="stable")
    ids = nodes[order].astype(np.int64)
    repeated = ids[1:][ids[1:] == ids[:-1]]
    if len(repeated):
        raise InputError(
            "contact nodes", expected="each node once", got=f"{np.unique(repeated)[:5].tolist()} repeatedly",
            fix="keep one row for each node",
        )
    wrong = int((~np.isfinite(displacements)).sum())
    if wrong:
        raise InputError(
            "contact displacements", expected="finite numbers", got=f"{wrong} others",
            fix="leave out contact nodes whose displacement is unknown",
        )
    largest = float(np.abs(displacements).max())
    if largest > _LARGEST:
        raise InputError(
            "contact displacements", expected=f"displacements in mm, at most {_LARGEST:g}", got=f"{largest:.3g}",
            fix="give the displacements of the nodes [mm]",
        )
    return ids, displacements[order].astype(np.float32)


def spread(nodes: IntArray, displacements: Float32Array, *, n_nodes: int) -> Float32Array:
    """The displacement of contact nodes, zero elsewhere [mm], float32, shape (n, 3): what networks read.

    Args:
        nodes: contact nodes, shape (c,).
        displacements: of each [mm], shape (c, 3).
        n_nodes: number n of mesh nodes.
    """
    field = np.zeros((n_nodes, 3), dtype=np.float32)
    field[nodes] = displacements
    return field


def checked_history(history: object | None) -> "ContactHistory | None":
    """The history of an answer, as `press` takes it.

    Raises:
        InputError: something else.
    """
    if history is None:
        return None
    from mixpinn.press.records import ContactHistory

    if not isinstance(history, ContactHistory):
        raise InputError(
            "history", expected="that of this predictor's answer", got=type(history).__name__,
            fix="hand over the history of an answer of the same predictor",
        )
    return history
