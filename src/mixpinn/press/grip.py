"""Grip: what the forces of probes on the skin are judged by, before they are corrected.

Contact from the pose is solved on the faces of the model's own mesh, which are large beside a probe's edge: it misses a
part of the force along the probe, which finer skin tells better (`mixpinn.press.fine_skin`), and most of the force
across it. The latter hardly shows in the former, but a body that is held far away sways by it. What it must be is known
better than from the contact of single points: the probe grips the skin, so that what presses against it does not move
across it. With the normal forces n of contact shared out
among the nodes as w, the patch moves by C f under a force f, C = Bᵀ W B with B = w ⊗ 1, and the force across that holds
it is

    t = −C_tt⁻¹ C_tn n,        δt = −C_tt⁻¹ Bᵀ s

to second order, where s is the way that one Newton step of the true equilibrium leads the nodes under n and t.
"""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.press.newton_shift import newton_shift
from mixpinn.press.records import ContactPrediction
from mixpinn.reduced.compliance.row_products import block_of
from mixpinn.reduced.hybrid import HybridModel

_DEPTH = 20.0
"""Depths are told as parts of this [mm]."""
_LEAST = 1e-3
"""Of a force whose logarithm is taken [N]."""
_SHARE = 0.05
"""The force on finer skin counts as at least this part of that of the contact, which may reach skin that it misses."""
SIGNS = 11
"""Signs of the force along a probe: 1, d, d², log n, d log n, log c, d log c, log |C_tt|, r, r² and log n/n₀; d the
depth, n the force of the contact, n₀ that on finer skin, c the compliance along the probe, r the share of the way along
that the Newton step takes back."""


@dataclass(frozen=True, eq=False)
class Grip:
    """Forces of k pushing probes on l nodes.

    Attributes:
        probes: which of the contact's probes push, shape (k,).
        weights: w of each, shape (k, l).
        response: displacement of the nodes under a unit force of each probe along x, y, z [mm/N], shape (3 l, 3 k).
        sides: two directions across each, shape (3 k, 2 k).
        yielding: C_tt, displacement of the patches along them under forces along them [mm/N], shape (2 k, 2 k).
        along: pressing directions, shape (k, 3).
        push: force along them [N], shape (k,).
        firm: n₀, force along them on finer skin, or `push` again where there is none [N], shape (k,).
        across: rest of the force in the contact [N], shape (k, 3).
        held: t, what holds the skin where it is [N], shape (k, 3).
        eased: δt [N], shape (k, 3).
        depth: beyond first touch, as a part of `_DEPTH`, shape (k,).
        signs: of the force along, shape (k, `SIGNS`).
        bent: root mean square of s [mm].
    """

    probes: IntArray
    weights: FloatArray
    response: FloatArray
    sides: FloatArray
    yielding: FloatArray
    along: FloatArray
    push: FloatArray
    firm: FloatArray
    across: FloatArray
    held: FloatArray
    eased: FloatArray
    depth: FloatArray
    signs: FloatArray
    bent: float

    def force_of(self, moved: FloatArray) -> FloatArray:
        """Forces across that move the patches across by `moved` (k, 3) [mm], shape (k, 3) [N]."""
        found: FloatArray = self.sides @ np.linalg.solve(self.yielding, self.sides.T @ moved.ravel())
        return found.reshape(-1, 3)

    def way_of(self, force: FloatArray) -> FloatArray:
        """How far forces across (k, 3) [N] move the patches across [mm], shape (k, 3)."""
        found: FloatArray = self.sides @ (self.yielding @ (self.sides.T @ force.ravel()))
        return found.reshape(-1, 3)

    @property
    def taken_back(self) -> float:
        """The largest share of the way along a probe that the Newton step takes back, or adds."""
        return float(np.abs(self.signs[:, 8]).max())

    @staticmethod
    def of_contact(
        hybrid: HybridModel, contact: ContactPrediction, rotations: FloatArray, fine: FloatArray | None = None,
    ) -> "Grip | None":
        """The grip of a contact of probes; None where nothing is pushed.

        Args:
            hybrid: the body.
            contact: of p probes.
            rotations: of these, shape (p, 3, 3).
            fine: their force on finer skin (`mixpinn.press.fine_skin`), if that is known [N], shape (p,).
        """
        axes = rotations @ PROBE_AXIS
        normal = np.maximum(np.einsum("kli,ki->kl", contact.shares, axes), 0.0)
        total = contact.shares.sum(axis=1)
        push = np.einsum("ki,ki->k", total, axes)
        probes = np.flatnonzero((push > 0.0) & (normal.sum(axis=1) > 0.0))
        if not len(probes):
            return None
        k, along, push = len(probes), axes[probes], push[probes]
        firm = push if fine is None else np.maximum(fine[probes], _SHARE * push)
        weights = normal[probes] / normal[probes].sum(axis=1, keepdims=True)
        across = total[probes] - push[:, None] * along
        system = hybrid.prior.hold(contact.nodes)
        block = block_of(hybrid.prior.own_compliance, system.rows)
        spread = np.einsum("kl,ij->likj", weights, np.eye(3)).reshape(3 * weights.shape[1], 3 * k)
        response = block @ spread
        patch = spread.T @ response
        sides = np.zeros((3 * k, 2 * k))
        for i, turn in enumerate(rotations[probes]):
            sides[3 * i : 3 * i + 3, 2 * i : 2 * i + 2] = turn[:, [0, 2]]
        yielding = sides.T @ patch @ sides
        normal_force = (push[:, None] * along).ravel()
        held = -(sides @ np.linalg.solve(yielding, sides.T @ (patch @ normal_force)))
        forces = contact.forces + np.einsum("kl,ki->li", weights, held.reshape(k, 3) - across)
        shift, here = newton_shift(hybrid, contact.nodes, forces)
        moved, way = spread.T @ shift.ravel(), spread.T @ here.ravel()
        eased = -(sides @ np.linalg.solve(yielding, sides.T @ moved))
        back = -np.einsum("ki,ki->k", moved.reshape(k, 3), along) / np.maximum(
            np.einsum("ki,ki->k", way.reshape(k, 3), along), 1e-9,
        )
        depth = np.maximum(contact.depths[probes], 0.0) / _DEPTH
        own = np.stack([patch[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(k)])
        sideways = np.stack([yielding[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(k)])
        compliance = np.log(np.einsum("ki,kij,kj->k", along, own, along))
        force, one = np.log(np.maximum(push, _LEAST)), np.ones(k)
        signs = np.stack([
            one, depth, depth**2, force, depth * force, compliance, depth * compliance,
            np.log(np.linalg.det(sideways)), back, back**2, np.log(push / firm),
        ], axis=1)
        return Grip(
            probes, weights, response, sides, yielding, along, push, firm, across, held.reshape(k, 3),
            eased.reshape(k, 3), depth, signs, float(np.sqrt((shift**2).sum(axis=1).mean())),
        )
