"""Contact of the probe, held in one place, with a patch of skin: what one load step solves against."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.fem.contact.model import ContactModel, FrictionFrame
from mixpinn.fem.contact.pair_kernel import Anchors, Pairs, evaluate
from mixpinn.fem.contact.surfaces import SkinPatch
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.geometry.triangle_search import close_pairs, points_beneath
from mixpinn.physics.contact_law import ContactConstants

MARGIN = 2.0
"""How far [mm] a vertex may move before close pairs are sought again."""


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Contact evaluated at one configuration of a patch with v vertices; p contact points on probe and patch.

    Attributes:
        energy: of contact and of friction at the current normal forces [N mm].
        gradient: of contact and friction by vertex positions [N], shape (v, 3); forces are its negative.
        stiffness: derivative of `gradient` among the a vertices that are touched, zero for others [N/mm], shape
            (3 a, 3 a); not symmetric where contact points slip.
        touched: which vertices these are, shape (v,).
        slip: elastic slip of each contact point if the step ended here [mm], shape (p, 3).
        normal_force: of each contact point [N], shape (p,).
        penetration: largest violation of the gap [mm].
        hits: number of active pairs.
        pressed: vertices of the skin whose faces carry pressure, where the gap law is integrated over faces.
    """

    energy: float
    gradient: FloatArray
    stiffness: FloatArray
    touched: BoolArray
    slip: FloatArray
    normal_force: FloatArray
    penetration: float
    hits: int
    pressed: IntArray | None = None


class ContactProblem:
    """Contact as a function of the positions of a patch's vertices, for one pose of the probe.

    Contact points are the probe's samples followed by the patch's vertices.
    """

    def __init__(
        self, model: ContactModel, patch: SkinPatch, pose: ProbePose, frame: FrictionFrame, *, stick: float = 1.0,
    ) -> None:
        """Place the probe.

        Args:
            model: probe, skin and laws.
            patch: the skin that the probe can reach; contact elsewhere is not seen.
            pose: of the probe.
            frame: what friction refers to.
            stick: share of the stiffness with which points stick before they slide. Elastic slip that is carried
                from step to step is that of the whole stiffness.
        """
        self.model, self.patch, self.pose, self.stick = model, patch, pose, stick
        n_samples = len(model.probe.samples)
        self._samples = pose.place(model.probe.samples)
        self._corners = pose.place(model.probe.vertices)
        chosen = np.concatenate([np.arange(n_samples), n_samples + patch.vertices])
        local = np.full(len(model.skin.nodes), -1, dtype=np.int64)
        local[patch.vertices] = np.arange(len(patch.vertices))
        vertices = local[frame.vertices[chosen]]
        anchored = frame.anchored[chosen] & (vertices >= 0).all(axis=1)
        self._anchors = Anchors(
            anchored, np.where(anchored[:, None], vertices, 0), frame.weights[chosen], frame.normal[chosen],
            frame.slip[chosen] / stick - frame.start[chosen] - pose.place(frame.local[chosen]),
        )
        self._seen_at: FloatArray | None = None
        nothing = np.empty((0, 2), dtype=np.int64)
        self._sample_pairs, self._vertex_pairs = nothing, nothing

    def evaluate(self, positions: FloatArray, *, exact: bool = True, share: float = 1.0) -> ContactForces:
        """Energy, forces and stiffness.

        Args:
            positions: of the patch's vertices [mm], shape (v, 3).
            exact: whether the stiffness is the derivative of the gradient; otherwise it lacks N ∂²d and how friction
                depends on N, and is symmetric and positive semi-definite.
            share: of the contact's stiffness along and across the normal: less than one on the way to a solution.
        """
        positions = np.ascontiguousarray(positions)
        self._seek_pairs(positions)
        config = self.model.config
        pairs = Pairs(
            self._samples, self._corners, self.model.probe.surface.triangles, self.patch.triangles, self._sample_pairs,
            self._vertex_pairs,
        )
        stiffness = share * config.stiffness
        law = ContactConstants(stiffness, config.smoothing, config.friction, self.stick * stiffness)
        energy, penetration, hits, gradient, hessian, touched, force, slip = evaluate(
            positions, pairs, self._anchors, law, config.gap, exact,
        )
        rows = np.flatnonzero(np.repeat(touched, 3))
        return ContactForces(
            energy, gradient, hessian[np.ix_(rows, rows)], touched, slip, force, penetration, hits,
        )

    def slip_everywhere(self, forces: ContactForces) -> FloatArray:
        """Elastic slip of all contact points of probe and skin [mm], shape (`ContactModel.n_points`, 3)."""
        n_samples = len(self._samples)
        slip = np.zeros((self.model.n_points, 3))
        slip[:n_samples] = self.stick * forces.slip[:n_samples]
        slip[n_samples + self.patch.vertices] = self.stick * forces.slip[n_samples:]
        return slip

    def tunnelled(self, positions: FloatArray) -> bool:
        """Whether a probe sample that was near the skin at the start of the step is on its wrong side now.

        Args:
            positions: of the patch's vertices [mm], shape (v, 3).
        """
        near = self._samples[self._anchors.anchored[: len(self._samples)]]
        return bool(points_beneath(near, np.ascontiguousarray(positions), self.patch.triangles).any())

    def _seek_pairs(self, positions: FloatArray) -> None:
        """List the pairs that may touch, again only where a vertex has moved far since the last time."""
        if self._seen_at is not None and ((positions - self._seen_at) ** 2).sum(axis=1).max(initial=0.0) <= MARGIN**2:
            return
        cutoff = self.model.config.gap + MARGIN
        self._seen_at = positions.copy()
        self._sample_pairs = np.stack(close_pairs(self._samples, positions, self.patch.triangles, cutoff), axis=1)
        self._vertex_pairs = np.stack(
            close_pairs(positions, self._corners, self.model.probe.surface.triangles, cutoff), axis=1,
        )
