"""PoseModel: from the poses of probes alone to the displacement of every node, their forces and the rigid motions.

Contact is solved on the linear body (`mixpinn.press.contact`), which makes forces λ⁰ and unknowns q⁰ = C λ⁰. One
Newton step of the true equilibrium from there, restricted to the patch of skin, says where the skin would really be,

    s = −C_Pᵀ r(q⁰),    r the residual with λ⁰ among the forces,

and contact goes on from where it is to equilibrium with y = β s − W λ. Tissue that stiffens as it is pressed makes the
step too long: β ≤ 1 is the part of it with which forces fit simulations best. The displacement of the loaded nodes
then goes to the hybrid model, as one that was given would. Where a law of the forces was learned
(`mixpinn.press.force_law`), from those on finer skin (`mixpinn.press.fine_skin`), the body follows these instead,
linearly. What is left is learned from simulations as

    q = q_hybrid + Ωᵀ H φ,    w = w¹ + K φ_p,    φ = [a, a ⊗ a],

with a the principal coordinates of the linear answer to the forces (φ_p: to those of one probe), Ω modes of what the
hybrid model leaves on its own contact, and H, K ridge regressions. There is no constant in φ: without contact nothing
moves. The twists in q move the rigid parts by finite rotations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray
from mixpinn.geometry.probe_pose import PATH_STEP
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.error_law import PoseErrorLaw
from mixpinn.press.fine_skin import FineContact
from mixpinn.press.force_law import ForceLaw
from mixpinn.press.grip import Grip
from mixpinn.press.newton_shift import newton_shift
from mixpinn.press.probe_field import ProbeField
from mixpinn.press.records import ContactHistory, ContactPrediction, check_poses
from mixpinn.records.answer import Trust
from mixpinn.reduced.compliance.row_products import combine_rows
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.quadratic_features import quadratic_features

_TWICE = 25.0
"""Errors are expected to be twice as large this far outside of all tips that were learned from [mm]. Without it, where
an end of one patient's spine was left out of the fit, bounds held for nine in ten of 150 presses up to 50 mm away."""
_SOME = 0.03
"""A smaller share of the way, taken back by a Newton step, tells no more of the error."""


@dataclass(frozen=True, eq=False)
class PoseCorrection:
    """What simulations teach about contact from the pose; m modes, k coordinates, f = k + k (k + 1) / 2 features.

    Attributes:
        modes: Ω, shape (m, D).
        gain: H, shape (f, m).
        wrench_gain: K, shape (f, 6).
        scale: of each coordinate, by which it is divided, shape (k,).
        largest: how large the correction of a field and of a force may be, relative to them, shape (2,).
    """

    modes: Float32Array
    gain: Float32Array
    wrench_gain: FloatArray
    scale: Float32Array
    largest: FloatArray

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
        trust: what to think of it.
    """

    displacement: Float32Array
    unknowns: Float32Array
    twists: FloatArray
    wrench: FloatArray
    contact: ContactPrediction
    trust: Trust


@dataclass(frozen=True, eq=False)
class Touch:
    """Contact of p probes, before the body is deformed by it.

    Attributes:
        rotations, translations: of the probes, shapes (p, 3, 3) and (p, 3) [mm].
        contact: nodes, displacement, forces; its history may be handed to the next call.
        bent: root mean square of the shift by the Newton step [mm].
        learned: whether its forces were corrected and the body follows these, not the nodes.
        taken_back: share of the way that a Newton step takes back then, see `Grip.taken_back`.
    """

    rotations: FloatArray
    translations: FloatArray
    contact: ContactPrediction
    bent: float
    learned: bool = False
    taken_back: float = 0.0


@dataclass(frozen=True, eq=False)
class Uncorrected:
    """A prediction before the learned correction; k coordinates, p probes.

    Attributes:
        contact: nodes, displacement, forces.
        unknowns: [mm, rad], shape (D,).
        coordinates: a of all forces, shape (k,).
        of_probes: a of the forces of each probe, shape (p, k).
        bent: root mean square of the shift by the Newton step [mm].
        stepped: norm of the hybrid model's correction [mm times √n]; where the body follows learned forces, the share
            of the way that a Newton step takes back, beside a little, times √n.
    """

    contact: ContactPrediction
    unknowns: Float32Array
    coordinates: Float32Array
    of_probes: Float32Array
    bent: float = 0.0
    stepped: float = 0.0


@dataclass(frozen=True, eq=False)
class PoseModel:
    """Poses in, deformation out.

    Attributes:
        hybrid: contact displacement in, displacement out.
        contact: contact of poses on its prior.
        probes: the tools whose poses it takes.
        domain: which poses were learned from.
        correction: learned from simulations, if any.
        error: which errors to expect, where the model was calibrated.
        steps: Newton steps of contact; 0 leaves it on the linear body.
        bend: β, the part of a Newton step that contact takes; where it takes none, none is computed.
        law: the force of the first of the probes, if that was learned.
        fine: contact on finer skin, which the law begins with, if there is one.
    """

    hybrid: HybridModel
    contact: PriorContact
    probes: tuple[ProbeField, ...]
    domain: PoseDomain
    correction: PoseCorrection | None = None
    error: PoseErrorLaw | None = None
    steps: int = 1
    bend: float = 1.0
    law: ForceLaw | None = None
    fine: FineContact | None = None

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
            InputError: poses that are no rotations, not finite, or not as many as probes; or that make no sense: from
                another side of the body than was learned, or far beyond first touch.
        """
        return self.deform(self.touch(rotations, translations, probes=probes, history=history))

    def touch(
        self, rotations: AnyArray, translations: AnyArray, *, probes: Sequence[int] | None = None,
        history: ContactHistory | None = None,
    ) -> Touch:
        """The first part of a prediction, contact; arguments and errors of `predict`."""
        chosen = range(len(np.asarray(translations))) if probes is None else probes
        fields = [self.probes[i] for i in chosen]
        turns, places = check_poses(len(fields), rotations, translations)
        return self._touch(turns, places, fields, history, check=partial(self.domain.refuse_nonsense, turns))

    def deform(self, touch: Touch) -> PosePrediction:
        """The second part of a prediction, the body under a contact that `touch` found."""
        base = self._deformed(touch)
        unknowns, wrench = self.corrected(base)
        coordinates = self.hybrid.prior.coordinates
        displacement = coordinates.expand(unknowns)
        trust = self._trust(base, unknowns, wrench, (touch.rotations, touch.translations), displacement)
        return PosePrediction(displacement, unknowns, coordinates.twists(unknowns), wrench, base.contact, trust)

    def corrected(self, base: Uncorrected) -> tuple[Float32Array, FloatArray]:
        """Unknowns (D,) and wrenches (p, 6) with what was learned, which stays a limited part of the whole."""
        unknowns, wrench = base.unknowns, base.contact.wrench
        correction = self.correction
        if correction is None or not len(base.contact.nodes):
            return unknowns, wrench
        amount = np.einsum("f,fm->m", correction.features(base.coordinates), correction.gain)
        size, whole = float(np.linalg.norm(amount)), self._size(unknowns)
        amount *= min(1.0, float(correction.largest[0]) * whole / max(size, 1e-12))
        unknowns = unknowns.copy()
        combine_rows(correction.modes, np.arange(len(correction.modes)), amount.astype(np.float32), unknowns)
        more = correction.features(base.of_probes).astype(np.float64) @ correction.wrench_gain
        size = np.linalg.norm(more[:, :3], axis=1)
        whole = np.linalg.norm(wrench[:, :3], axis=1)
        more *= np.minimum(1.0, correction.largest[1] * whole / np.maximum(size, 1e-12))[:, None]
        return unknowns, wrench + more

    def signs(self, base: Uncorrected, unknowns: Float32Array, wrench: FloatArray) -> FloatArray:
        """What errors show in: field, force, depth, bend, hybrid model's step, learned parts, motion [mm, N], (8,)."""
        root = np.sqrt(self.hybrid.mesh.n_points)
        motions = self.hybrid.prior.coordinates.twists(unknowns)[:, :3]
        return np.array([
            self._size(unknowns) / root, np.linalg.norm(wrench[:, :3]), max(float(base.contact.depths.max()), 0.0),
            base.bent, base.stepped / root, self._size(unknowns - base.unknowns) / root,
            np.linalg.norm((wrench - base.contact.wrench)[:, :3]), np.linalg.norm(motions, axis=1).max(initial=0.0),
        ])

    def _size(self, unknowns: Float32Array) -> float:
        """Root of the sum of squared displacements of all nodes [mm]."""
        return float(np.linalg.norm(self.hybrid.prior.coordinates.weights * unknowns))

    def _trust(
        self, base: Uncorrected, unknowns: Float32Array, wrench: FloatArray, poses: tuple[FloatArray, FloatArray],
        displacement: Float32Array,
    ) -> Trust:
        """Expected errors and bounds; reasons why the answer is outside, or why nothing moves."""
        contact = base.contact
        outside = list(self.domain.reasons(*poses, contact.depths))
        notes = [] if contact.converged else ["contact did not converge"]
        step = self.contact.config.step
        if step != PATH_STEP:
            notes.append(f"fitted on paths in steps of {step:g} mm instead of {PATH_STEP:g} mm: fit the model again")
        if not len(contact.nodes):
            notes.append("the probe touches nothing: nothing moves")
            return Trust(
                expected=0.0, bound=0.0, level=1.0, outside=bool(outside), reasons=(*outside, *notes),
                converged=contact.converged, force_expected=0.0, force_bound=0.0, motion_expected=0.0, motion_bound=0.0,
            )
        farthest = float(np.sqrt(np.einsum("ij,ij->i", displacement, displacement).max()))
        if not farthest <= 1.5 * contact.depths.max() + 2.0:
            outside.append(f"a node moves by {farthest:.0f} mm, farther than the probe pushes")
        if self.contact.at_the_rim(contact):
            outside.append("contact reaches the rim of the skin that was prepared")
        reasons = (*outside, *notes)
        if self.error is None:
            return Trust(outside=bool(outside), reasons=reasons, converged=contact.converged)
        expected = self.error.expected(self.signs(base, unknowns, wrench))
        expected *= 1.0 + self.domain.beyond(poses[1]) / _TWICE
        bound = self.error.factor * expected
        return Trust(
            float(expected[0]), float(bound[0]), self.error.level, bool(outside), reasons, contact.converged,
            force_expected=float(expected[1]), force_bound=float(bound[1]), motion_expected=float(expected[2]),
            motion_bound=float(bound[2]),
        )

    def uncorrected(
        self, rotations: AnyArray, translations: AnyArray, *, probes: Sequence[int] | None = None,
        history: ContactHistory | None = None,
    ) -> Uncorrected:
        """The prediction without what was learned about contact; arguments of `predict`."""
        chosen = range(len(np.asarray(translations))) if probes is None else probes
        fields = [self.probes[i] for i in chosen]
        return self._deformed(self._touch(*check_poses(len(fields), rotations, translations), fields, history))

    def _touch(
        self, rotations: FloatArray, translations: FloatArray, fields: Sequence[ProbeField],
        history: ContactHistory | None, *, check: Callable[[FloatArray], None] | None = None,
    ) -> Touch:
        """Contact on the body as one Newton step bends it."""
        session = self.contact.open(fields, rotations, translations, history, check=check)
        bent = 0.0
        # Where no part of the step is taken, contact stays as it is: a history must not tell of multipliers that the
        # answer has not been solved with.
        for _ in range(self.steps if self.bend > 0.0 else 0):
            if not session.force.any():
                break
            shift = self.bend * newton_shift(self.hybrid, session.nodes, -session.force.reshape(-1, 3))[0]
            bent = float(np.sqrt((shift**2).sum(axis=1).mean()))
            session = session.shifted(shift)
        contact = session.outcome()
        if self.law is not None and all(field is self.probes[0] for field in fields):
            grip = self.grip(contact, rotations, translations)
            if grip is not None:
                places, dragged = self.hybrid.mesh.node_points[contact.nodes], None
                if history is not None and history.dragged is not None and history.force.any():
                    dragged = history.dragged + translations - history.translations
                friction = self.contact.config.friction
                contact = self.law.corrected(contact, grip, places, translations, dragged, friction=friction)
                return Touch(rotations, translations, contact, grip.bent, self.law.moves, grip.taken_back)
        return Touch(rotations, translations, contact, bent)

    def grip(self, contact: ContactPrediction, rotations: FloatArray, translations: FloatArray) -> Grip | None:
        """What the forces of p probes like the first are judged by; None where none pushes.

        Args:
            contact: of theirs.
            rotations, translations: of the probes, shapes (p, 3, 3) and (p, 3) [mm].
        """
        fine = None
        if self.fine is not None and len(contact.nodes):
            fine = self.fine.push((self.probes[0],) * len(translations), rotations, translations)
        return Grip.of_contact(self.hybrid, contact, rotations, fine)

    def _deformed(self, touch: Touch) -> Uncorrected:
        """The body under a contact: as the hybrid model has it, or, where forces were learned, as these move it."""
        prior, readers, contact = self.hybrid.prior, self.hybrid.readers, touch.contact
        if not len(contact.nodes):
            still, zero = (np.zeros(size, dtype=np.float32) for size in (prior.coordinates.size, len(readers)))
            return Uncorrected(contact, still, zero, np.tile(zero, (len(contact.wrench), 1)))
        held = prior.hold(contact.nodes)
        if touch.learned:
            unknowns = prior.respond_to_forces(held, contact.forces.ravel())
            stepped = float(np.sqrt(self.hybrid.mesh.n_points)) * (_SOME + touch.taken_back)
        else:
            state = self.hybrid.solve(contact.nodes, contact.displacement)
            unknowns, stepped = state.unknowns, float(np.linalg.norm(state.correction))
        shares = contact.shares.reshape(len(contact.shares), -1).astype(np.float32)
        part = readers[:, held.rows]
        return Uncorrected(contact, unknowns, part @ shares.sum(axis=0), shares @ part.T, touch.bent, stepped)

    def with_law(self, base: Uncorrected, law: ForceLaw, grip: Grip, tips: FloatArray) -> Uncorrected:
        """A prediction without a law of forces as one with `law`; `grip` is that of its contact, `tips` (p, 3) [mm]."""
        places = self.hybrid.mesh.node_points[base.contact.nodes]
        contact = law.corrected(base.contact, grip, places, tips)
        return self._deformed(Touch(np.empty((0, 3, 3)), tips, contact, grip.bent, law.moves, grip.taken_back))
