"""Where one Newton step of the true equilibrium leads the skin under forces, from the linear body's answer."""

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.reduced.hybrid import HybridModel

_LARGEST = 0.6
"""It moves no node of the skin by more than this part of the linear answer's largest displacement."""


def newton_shift(hybrid: HybridModel, nodes: IntArray, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The step of some contact nodes, and their displacement in the linear answer [mm], both (n, 3).

    Where the linear answer is so far off that the step means nothing, it stays a part of that answer.

    Args:
        hybrid: the body.
        nodes: which they are, shape (n,).
        forces: on each [N], shape (n, 3); nowhere else are there any.
    """
    prior, coordinates = hybrid.prior, hybrid.prior.coordinates
    on = np.flatnonzero((forces != 0.0).any(axis=1))
    loaded, patch = prior.hold(nodes[on]), prior.hold(nodes)
    unknowns = prior.respond_to_forces(loaded, forces[on].ravel())
    near = hybrid.newton.near
    if near is None:
        residual = hybrid.newton.equilibrium.residual(unknowns, coordinates)
        residual[loaded.unknowns] -= forces[on].ravel().astype(np.float32)
    else:  # the linear answer balances the forces: what is beyond linear elasticity is all that is left
        residual = near.residual(unknowns, coordinates, loaded.rows)
    shift: FloatArray = -prior.compliance.read(patch.rows, residual).reshape(-1, 3).astype(np.float64)
    here = unknowns[patch.unknowns].reshape(-1, 3).astype(np.float64)
    most = _LARGEST * np.sqrt((here**2).sum(axis=1).max())
    size = np.sqrt((shift**2).sum(axis=1).max())
    return shift * min(1.0, float(most) / max(float(size), 1e-12)), here
