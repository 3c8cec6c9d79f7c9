"""ForceLaw: the force of a probe on the skin, learned from simulations, and the contact that goes with it.

From a grip (`mixpinn.press.grip`) with force n along the probe, n₀ that on finer skin, and t and δt across it,

    n' = n₀ exp(c · φ),    t'_j = (n'/n) (a_j t_j + b_j δt_j + …),

φ the signs of the grip and j two axes of the body across the pressing direction: along and across the spine a body
yields differently, so that each axis has its own coefficients, which change with depth. The difference to the force of
the contact is shared out among the nodes as the normal force is; they move as the linear body does. The deformation is
then the linear answer to these forces: where forces are known, it needs no contact nodes, which cells under a probe do
not place well. Where that is nevertheless farther off, as with strains that are large, the law tells the force alone,
and the body follows the contact nodes.

Friction remembers a drag: a patch that was moved across by w, and grips, pulls with C_tt⁻¹ w more. Where that leans
farther than friction holds, t' is cut back, and w with it: the probe has slid.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.press.grip import Grip
from mixpinn.press.records import ContactPrediction

TERMS = 6
"""Of the force across: that of the contact, t and δt, each alone and times the depth."""


@dataclass(frozen=True, eq=False)
class ForceLaw:
    """The force of one probe.

    Attributes:
        along: c, shape (`mixpinn.press.grip.SIGNS`,).
        largest: no force n₀ is changed by more than the factor exp(`largest`), shape (1,).
        axes: of the body, shape (2, 3).
        across: coefficients of the terms of the force along each, shape (2, `TERMS`).
        moves: whether the body follows these forces; if not, it follows the contact nodes.
    """

    along: FloatArray
    largest: FloatArray
    axes: FloatArray
    across: FloatArray
    moves: bool = True

    def forces(
        self, grip: Grip, dragged: FloatArray | None = None, *, friction: float = 1.0,
    ) -> tuple[FloatArray, FloatArray]:
        """Forces of the k pushing probes [N], shape (k, 3), and how far they hold the skin from where it was, (k, 3).

        Args:
            grip: of the contact.
            dragged: how far each probe was moved across since it gripped [mm], shape (k, 3); None: straight down.
            friction: Coulomb's coefficient.
        """
        push = grip.firm * np.exp(np.clip(grip.signs @ self.along, -self.largest[0], self.largest[0]))
        ratio = push / grip.push
        still = np.zeros_like(grip.along) if dragged is None else _across(dragged, grip.along)
        pull = grip.force_of(still)
        terms = across_terms(replace(grip, across=grip.across - pull), self.axes)
        straight = _across(np.einsum("kjt,jt->kj", terms, self.across) * ratio[:, None] @ self.axes, grip.along)
        if dragged is None:
            return push[:, None] * grip.along + straight, still
        leaning = straight + pull
        size = np.linalg.norm(leaning, axis=1)
        limit = np.maximum(friction * push, np.linalg.norm(straight, axis=1))
        leaning = leaning * np.minimum(1.0, limit / np.maximum(size, 1e-12))[:, None]
        slides = size > limit
        if slides.any():
            still = np.where(slides[:, None], grip.way_of(leaning - straight), still)
        return push[:, None] * grip.along + leaning, still

    def corrected(
        self, contact: ContactPrediction, grip: Grip, places: FloatArray, tips: FloatArray,
        dragged: FloatArray | None = None, *, friction: float = 1.0,
    ) -> ContactPrediction:
        """`contact` with these forces, or with their wrench alone; a history of it tells how far the skin is held.

        Args:
            contact: of p probes.
            grip: of it.
            places: of its nodes at rest [mm], shape (l, 3).
            tips: of the probes [mm], shape (p, 3).
            dragged: as for `forces`, of all probes, shape (p, 3).
            friction: Coulomb's coefficient.
        """
        forces, held = self.forces(grip, None if dragged is None else dragged[grip.probes], friction=friction)
        everywhere = np.zeros((len(tips), 3))
        everywhere[grip.probes] = held
        changed = with_forces(contact, grip, forces, places, tips)
        if not self.moves:
            changed = replace(contact, wrench=changed.wrench)
        return replace(changed, history=replace(contact.history, dragged=everywhere))

    def arrays(self) -> dict[str, FloatArray]:
        """Its coefficients by name."""
        return {"along": self.along, "largest": self.largest, "axes": self.axes, "across": self.across}

    @staticmethod
    def of_arrays(arrays: Mapping[str, AnyArray], *, moves: bool) -> "ForceLaw":
        """From what `arrays` gave."""
        along, largest, axes, across = (
            np.asarray(arrays[name], dtype=np.float64) for name in ("along", "largest", "axes", "across")
        )
        return ForceLaw(along, largest, axes, across, moves)


def _across(vectors: FloatArray, along: FloatArray) -> FloatArray:
    """The parts of vectors (k, 3) across unit vectors (k, 3)."""
    found: FloatArray = vectors - np.einsum("ki,ki->k", vectors, along)[:, None] * along
    return found


def across_terms(grip: Grip, axes: FloatArray) -> FloatArray:
    """Terms of the force across along two axes (2, 3) [N], shape (k, 2, `TERMS`)."""
    parts = np.stack([grip.across @ axes.T, grip.held @ axes.T, grip.eased @ axes.T], axis=2)
    return np.concatenate([parts, parts * grip.depth[:, None, None]], axis=2)


def with_forces(
    contact: ContactPrediction, grip: Grip, forces: FloatArray, places: FloatArray, tips: FloatArray,
) -> ContactPrediction:
    """`contact` whose pushing probes press with `forces` (k, 3) [N], and the skin where the linear body has it then.

    `places` and `tips` as for `ForceLaw.corrected`.
    """
    change = forces - grip.push[:, None] * grip.along - grip.across
    shares, wrench = contact.shares.copy(), np.zeros_like(contact.wrench)
    shares[grip.probes] += grip.weights[:, :, None] * change[:, None]
    displacement = contact.displacement + (grip.response @ change.ravel()).reshape(-1, 3)
    wrench[:, :3] = -shares.sum(axis=1)
    wrench[:, 3:] = -np.cross(places + displacement - tips[:, None], shares).sum(axis=1)
    return replace(contact, displacement=displacement, forces=shares.sum(axis=0), shares=shares, wrench=wrench)
