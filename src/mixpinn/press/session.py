"""ContactSession: probes in equilibrium with a patch of skin, and how they go on from there."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.geometry.rotations import rotation_from_vector, vector_from_rotation
from mixpinn.press.path_kernel import Path, Skin, follow
from mixpinn.press.records import ContactHistory, ContactPrediction, PlacedFields

if TYPE_CHECKING:
    from mixpinn.press.contact import PriorContact

_PATIENCE = 100_000
"""More tries than any way takes whose solves converge or are given up one by one."""


@dataclass(frozen=True, eq=False)
class ContactSession:
    """Probes at their poses in equilibrium with a patch of skin, and all that is needed to go on from there.

    Attributes:
        contact: whose candidates and settings these are.
        placed: the probes where they are.
        patch: nodes of the patch by index into the candidates, shape (n,).
        points: of the skin, by index into all of them, shape (p,).
        stencil: their nodes by index into the patch, shape (p, w).
        compliance: of the patch, shape (3 n, 3 n).
        depths: of the probes beyond first touch [mm], shape (k,).
        shift: where the patch would be without contact, relative to rest [mm], shape (n, 3).
        force: gradient of contact, shape (3 n,).
        slip: elastic slips in the probes' frames [mm], shape (k, p, 3).
        lead: violations of the gap that count beside the present ones [mm], shape (k, p).
        push: normal forces [N], shape (k, p).
        pull: forces of the probes on the points [N], shape (k, p, 3).
        converged, tries: of all solves so far.
        way: placements from first touch to where the probes are, or None where they came from a history.
        lost: whether a step found no equilibrium even without friction; the state is that before it.
    """

    contact: "PriorContact"
    placed: PlacedFields
    patch: IntArray
    points: IntArray
    stencil: IntArray
    compliance: FloatArray
    depths: FloatArray
    shift: FloatArray
    force: FloatArray
    slip: FloatArray
    lead: FloatArray
    push: FloatArray
    pull: FloatArray
    converged: bool
    tries: int
    way: tuple[FloatArray, FloatArray] | None = None
    lost: bool = False

    @property
    def patience(self) -> int:
        """The most tries from here on; see `follow`."""
        return _PATIENCE

    @property
    def nodes(self) -> IntArray:
        """Mesh nodes of the patch, ascending, shape (n,)."""
        found: IntArray = self.contact.nodes[self.patch]
        return found

    def shifted(self, shift: FloatArray) -> "ContactSession":
        """Contact at the same poses when the patch without contact lies at rest + `shift` [mm], shape (n, 3).

        The violations of the gap found so far count as multipliers, so that what is left of them is small.
        """
        # In parts of a fixed length, the last one shorter, as a path goes: answers change steadily with the shift.
        size = float(np.abs(shift - self.shift).max(initial=0.0))
        reached = np.append(np.arange(0.0, size, self.contact.config.step), max(size, 1e-9))
        share = reached / reached[-1]
        still = tuple(
            np.repeat(array[None], len(reached), axis=0) for array in (self.placed.rotations, self.placed.translations)
        )
        stiffness = self.contact.config.stiffness * self.contact.skin.area[self.points]
        session = replace(self, lead=self.push / stiffness)
        moved = session.go(still, self.shift + share[:, None, None] * (shift - self.shift))
        if moved.converged or not self.converged or self.way is None:
            return moved
        down = session._down_again(self.way, shift)
        return down if down.converged else moved

    def _down_again(self, way: tuple[FloatArray, FloatArray], shift: FloatArray) -> "ContactSession":
        """Along the whole way from first touch, while the patch without contact moves from rest to `shift`."""
        nothing = replace(
            self, placed=replace(self.placed, rotations=way[0][0], translations=way[1][0]),
            shift=np.zeros_like(shift), force=np.zeros_like(self.force), slip=np.zeros_like(self.slip),
            push=np.zeros_like(self.push), pull=np.zeros_like(self.pull),
        )
        return nothing.go(way, np.linspace(0.0, 1.0, len(way[0]))[:, None, None] * shift)

    def go(self, path: "tuple[FloatArray, ...]", shifts: FloatArray | None = None) -> "ContactSession":
        """Follow placements, (s + 1, k, 3, 3) and (s + 1, k, 3), and shifts, (s + 1, n, 3), that begin here."""
        rotations, translations = path
        steps = len(rotations) - 1
        if shifts is None:
            shifts = np.repeat(self.shift[None], steps + 1, axis=0)
        session = self
        at = 0
        while at < steps and len(self.points) and not session.lost:
            way = rotations[at:], translations[at:]
            session, done = session._steps(way, shifts[at:], self.contact.config.friction)
            at += done
            if at < steps:
                two = slice(at, at + 2)
                session = session._divided((rotations[two], translations[two]), shifts[two], self.contact.cuts)
                at += 1
        placed = replace(self.placed, rotations=rotations[-1], translations=translations[-1])
        return replace(session, placed=placed, shift=shifts[-1])

    def _divided(self, path: tuple[FloatArray, FloatArray], shifts: FloatArray, cuts: int) -> "ContactSession":
        """One step in halves; without friction where they do not help either."""
        rotations, translations = path
        if not cuts:
            session, done = self._steps(path, shifts, 0.0)
            return replace(session if done else self, converged=False, lost=not done)
        half = vector_from_rotation(rotations[1] @ rotations[0].transpose(0, 2, 1)) / 2.0
        middle = rotation_from_vector(half) @ rotations[0]
        rotations = np.stack([rotations[0], middle, rotations[1]])
        translations = np.stack([translations[0], 0.5 * (translations[0] + translations[1]), translations[1]])
        shifts = np.stack([shifts[0], 0.5 * (shifts[0] + shifts[1]), shifts[1]])
        session = self
        for part in (slice(0, 2), slice(1, 3)):
            way = rotations[part], translations[part]
            session, done = session._steps(way, shifts[part], self.contact.config.friction)
            if not done:
                session = session._divided(way, shifts[part], cuts - 1)
            if session.lost:
                break
        return session

    def _steps(
        self, path: tuple[FloatArray, FloatArray], shifts: FloatArray, friction: float,
    ) -> "tuple[ContactSession, int]":
        """Where the path leads, and how many of its steps converged."""
        contact, config = self.contact, self.contact.config
        skin = contact.skin
        force, slip, push, pull, done, used = follow(
            contact.rest[self.patch], self.compliance,
            Skin(self.stencil, skin.weights[self.points], config.stiffness * skin.area[self.points]),
            self.placed.joined, Path(path[0], path[1], shifts), self.force, self.slip,
            self.push, self.lead, (config.gap, friction, config.smoothing), (config.tolerance, config.on_the_way),
            (config.max_iterations, self.patience),
        )
        if not done:  # nothing has changed, and the kernel tells no forces of points before the first step
            return replace(self, tries=self.tries + used), 0
        placed = replace(self.placed, rotations=path[0][done], translations=path[1][done])
        return replace(
            self, placed=placed, shift=shifts[done], force=force, slip=slip, push=push, pull=pull,
            tries=self.tries + used,
        ), int(done)

    def outcome(self) -> ContactPrediction:
        """Contact by mesh nodes and probes."""
        contact, placed = self.contact, self.placed
        k = len(placed.fields)
        moved = self.shift - np.einsum("ij,j->i", self.compliance, self.force).reshape(-1, 3)
        x = contact.rest[self.patch] + moved
        weights = contact.skin.weights[self.points]
        places = np.einsum("pw,pwr->pr", weights, x[self.stencil])
        stiffness = contact.config.stiffness * contact.skin.area[self.points]
        wrench, sliding, shares = np.zeros((k, 6)), np.zeros(k), np.zeros((k, len(self.patch), 3))
        for i in range(k):
            on = np.flatnonzero(self.push[i] > 0.0)
            if not len(on):
                continue
            force = self.pull[i, on]
            wrench[i, :3] = -force.sum(axis=0)
            turning = np.einsum("pi,pj->ij", places[on] - placed.translations[i], force)  # Σ rᵢ fⱼ
            turning = turning.T - turning
            wrench[i, 3:] = turning[1, 2], turning[2, 0], turning[0, 1]  # −Σ r × f
            np.add.at(shares[i], self.stencil[on], weights[on][..., None] * force[:, None])
            held = stiffness[on] * np.linalg.norm(self.slip[i, on], axis=1)
            slides = held >= contact.config.friction * self.push[i, on] * (1.0 - 1e-9)
            sliding[i] = float(self.push[i, on][slides].sum() / self.push[i, on].sum())
        forces = -self.force.reshape(-1, 3)
        loaded = np.flatnonzero((forces != 0.0).any(axis=1))
        probe, point = np.nonzero(self.push > 0.0)
        everywhere, shifts = np.zeros((2, len(contact.nodes), 3))
        everywhere[self.patch], shifts[self.patch] = self.force.reshape(-1, 3), self.shift
        history = ContactHistory(
            placed.rotations, placed.translations, everywhere, shifts, probe, self.points[point],
            self.slip[probe, point], self.lead[probe, point],
        )
        return ContactPrediction(
            self.nodes[loaded], moved[loaded], forces[loaded], shares[:, loaded], wrench, sliding, self.depths, history,
            self.converged, self.tries,
        )
