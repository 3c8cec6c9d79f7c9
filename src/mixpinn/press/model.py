"""PoseModel: from the poses of probes alone to the displacement of every node, their forces and the rigid motions.

Contact is solved on the linear body (`mixpinn.press.contact`), which makes forces λ⁰ and unknowns q⁰ = C λ⁰. One
Newton step of the true equilibrium from there, restricted to the patch of skin, says where the skin would really be,

    s = q⁰_P + W λ⁰ − C_Pᵀ r(q⁰),    r the residual with λ⁰ among the forces,

and contact is solved again on y = s − W λ. The displacement of the loaded nodes then goes to the hybrid model, as one
that was given would. What is left comes from contact, not from the body: it is learned from simulations as

    q = q_hybrid + Ωᵀ H φ,    w = w¹ + K φ_p,    φ = [a, a ⊗ a],

with a the principal coordinates of the linear answer to the forces (φ_p: to those of one probe), Ω modes of what the
hybrid model leaves on its own contact, and H, K ridge regressions. There is no constant in φ: without contact nothing
moves. The twists in q move the rigid parts by finite rotations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray
from mixpinn.press.contact import ContactSession, PriorContact
from mixpinn.press.records import ContactHistory, ContactPrediction, ProbeGeometry
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.quadratic_features import quadratic_features
from mixpinn.reduced.row_products import combine_rows, rows_times


@dataclass(frozen=True, eq=False)
class PoseCorrection:
    """What simulations teach about contact from the pose; m modes, k coordinates, f = k + k (k + 1) / 2 features.

    Attributes:
        modes: Ω, shape (m, D).
        gain: H, shape (f, m).
        wrench_gain: K, shape (f, 6).
        scale: of each coordinate, by which it is divided, shape (k,).
    """

    modes: Float32Array
    gain: Float32Array
    wrench_gain: FloatArray
    scale: Float32Array

    def features(self, coordinates: AnyArray) -> Float32Array:
        """φ of coordinates (…, ≥ k), shape (…, f)."""
        return quadratic_features(coordinates[..., : len(self.scale)] / self.scale)


@dataclass(frozen=True, eq=False)
class PosePrediction:
    """What follows from the poses of k probes; n mesh nodes, K rigid parts.

    Attributes:
        displacement: of every mesh node [mm], float32, shape (n, 3).
        unknowns: reduced unknowns [mm, rad], shape (D,).
        twists: translation of the centroid [mm] and rotation vector [rad] of each rigid part, shape (K, 6).
        wrench: force [N] and moment about the tip [N mm] of the tissue on each probe, shape (k, 6).
        contact: which nodes, how far, with what force; its history may be handed to the next call.
    """

    displacement: Float32Array
    unknowns: Float32Array
    twists: FloatArray
    wrench: FloatArray
    contact: ContactPrediction


@dataclass(frozen=True, eq=False)
class Uncorrected:
    """A prediction before the learned correction: contact, unknowns (D,), coordinates (k,) and of each probe (p, k)."""

    contact: ContactPrediction
    unknowns: Float32Array
    coordinates: Float32Array
    of_probes: Float32Array


@dataclass(frozen=True, eq=False)
class PoseModel:
    """Poses in, deformation out.

    Attributes:
        hybrid: contact displacement in, displacement out.
        contact: contact of poses on its prior.
        probes: that poses may be given of.
        correction: learned from simulations, if any.
        steps: Newton steps of contact; 0 leaves it on the linear body.
    """

    hybrid: HybridModel
    contact: PriorContact
    probes: tuple[ProbeGeometry, ...]
    correction: PoseCorrection | None = None
    steps: int = 1

    def predict(
        self, rotations: AnyArray, translations: AnyArray, *, probes: Sequence[int] | None = None,
        history: ContactHistory | None = None,
    ) -> PosePrediction:
        """Deformation with the probes at the given poses.

        Args:
            rotations: of each probe, shape (k, 3, 3).
            translations: position of each tip [mm], shape (k, 3).
            probes: which of `self.probes` each is; by default the first k.
            history: of an earlier prediction, where friction is to remember it. None: each probe came straight along
                its axis, and the result depends on nothing asked before.

        Raises:
            InputError: poses that are no rotations, not finite, or not as many as probes.
        """
        base = self.uncorrected(rotations, translations, probes=probes, history=history)
        unknowns, wrench = base.unknowns, base.contact.wrench
        if self.correction is not None and len(base.contact.nodes):
            correction = self.correction
            unknowns = unknowns.copy()
            combine_rows(
                correction.modes, np.arange(len(correction.modes)),
                correction.features(base.coordinates) @ correction.gain, unknowns,
            )
            wrench = wrench + correction.features(base.of_probes).astype(np.float64) @ correction.wrench_gain
        coordinates = self.hybrid.prior.coordinates
        return PosePrediction(
            coordinates.expand(unknowns), unknowns, coordinates.twists(unknowns), wrench, base.contact,
        )

    def uncorrected(
        self, rotations: AnyArray, translations: AnyArray, *, probes: Sequence[int] | None = None,
        history: ContactHistory | None = None,
    ) -> Uncorrected:
        """The prediction without what was learned about contact; arguments of `predict`."""
        chosen = range(len(np.asarray(translations))) if probes is None else probes
        session = self.contact.open([self.probes[i] for i in chosen], rotations, translations, history)
        contact = session.solve()
        prior = self.hybrid.prior
        readers = self.hybrid.readers
        if not len(contact.nodes):
            zero = np.zeros(len(readers), dtype=np.float32)
            return Uncorrected(
                contact, np.zeros(prior.coordinates.size, dtype=np.float32), zero,
                np.tile(zero, (len(session.placed), 1)),
            )
        unknowns = None
        for _ in range(self.steps):
            if unknowns is None:
                unknowns = prior.respond_to_forces(prior.hold(contact.nodes), contact.forces.ravel())
            again = session.solve(self._shift(session, contact, unknowns), contact)
            if not again.converged or not len(again.nodes):
                break
            contact = again
            unknowns = None
        rows = prior.hold(contact.nodes).rows
        state = self.hybrid.solve(contact.nodes, contact.displacement)
        shares = contact.shares.reshape(len(contact.shares), -1).astype(np.float32)
        part = readers[:, rows]
        return Uncorrected(contact, state.unknowns, part @ shares.sum(axis=0), shares @ part.T)

    def _shift(
        self, session: ContactSession, contact: ContactPrediction, unknowns: Float32Array,
    ) -> FloatArray:
        """Where the patch would be without contact after one Newton step, relative to rest [mm], shape (p, 3)."""
        prior, equilibrium = self.hybrid.prior, self.hybrid.newton.equilibrium
        coordinates = prior.coordinates
        held = prior.hold(contact.nodes)
        residual = equilibrium.residual(coordinates.expand(unknowns), coordinates)
        residual[held.unknowns] -= contact.forces.ravel().astype(np.float32)
        patch = prior.hold(session.nodes)
        answer = np.empty(len(patch.rows), dtype=np.float32)
        rows_times(prior.compliance, patch.rows, residual, answer)
        here = unknowns[patch.unknowns].astype(np.float64)
        force = -contact.history.force[session.patch].ravel()
        shift: FloatArray = here - session.compliance @ force - answer
        return shift.reshape(-1, 3)
