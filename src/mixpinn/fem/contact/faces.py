"""Contact integrated over the faces of the skin: how quadratic elements touch the probe.

Under a uniform pressure the vertices of a six-node face carry nothing and its midpoints a third of the force each, so
that equal penalties at nodes would press a flat probe into the face. The gap law is integrated instead: its energy per
area, φ of `mixpinn.physics.contact_law` with the stiffness per area k / s² of its contact points at their spacing s, is
summed over points of the rest faces about s apart, each with its area and the shape functions of its face. The law
does then not depend on the mesh, a uniform pressure passes the patch test, and the forces on the nodes are those of
the pressure. (The abstract of S. A. Maas et al., Finite element simulation of articular contact mechanics with
quadratic tetrahedral elements, Journal of Biomechanics, 2016, reports that accuracy and convergence hang on the
integration over the surface.)

A point meets the nearest place of the probe. Points lie closer together than the gap is wide, so that no corner of the
probe gets between them. Friction acts at the points as it does at the contact points of linear elements.
"""

from dataclasses import dataclass, field

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.fem.contact.face_kernel import bounding_capsules, evaluate_faces, nearest_on_probe
from mixpinn.fem.contact.model import ContactConfig, ContactModel
from mixpinn.fem.contact.problem import MARGIN, ContactForces
from mixpinn.fem.contact.surfaces import SkinPatch, SkinSurface
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.geometry.probe_surface import ProbeSurface
from mixpinn.geometry.triangle_search import close_pairs, points_beneath
from mixpinn.physics.contact_law import ContactConstants
from mixpinn.physics.face_points import FacePoints

SLIP_SHARE = 1.0 / 16.0
"""Stiffness of friction before a point slides, as a share of that across the gap.

Under the pressures of a probe a point slides after some micrometres of elastic slip either way. As stiff as the gap,
friction changes from sticking to sliding within tenths of a micrometre, and Newton's method takes three to five times
as many steps to find out where."""


@dataclass(frozen=True, eq=False)
class FaceFrame:
    """What friction refers to during one step; c points that were near the probe at its start.

    Attributes:
        points: these points, ascending, shape (c,).
        local: the place of the probe nearest to each, in the probe's frame [mm], shape (c, 3).
        normal: unit normal at the start of the step, from probe to skin, shape (c, 3).
        start: relative position skin − probe at the start of the step [mm], shape (c, 3).
        slip: elastic slip carried into the step [mm], shape (c, 3).
        samples: samples of the probe that were near the skin, shape (q,).
    """

    points: IntArray
    local: FloatArray
    normal: FloatArray
    start: FloatArray
    slip: FloatArray
    samples: BoolArray


@dataclass(frozen=True, eq=False)
class FaceContactModel(ContactModel):
    """Contact of one probe with the faces of one skin; contact points are the points of `FacePoints`.

    Triangles of the skin are those of its faces in turn: one of a face of three vertices, four of one of six.

    Attributes:
        points: over which the gap law is integrated.
    """

    points: FacePoints = field(kw_only=True)

    @staticmethod
    def of_faces(
        skin: SkinSurface, faces: IntArray, rest: FloatArray, probe: ProbeSurface, config: ContactConfig,
    ) -> "FaceContactModel":
        """Contact with a skin whose faces are `faces` (f, 3) or (f, 6) between its vertices, at rest `rest` (v, 3)."""
        points = FacePoints.build(faces, rest[faces[:, :3]], spacing=config.spacing)
        return FaceContactModel(skin, probe, config, points=points)

    @property
    def n_points(self) -> int:
        """Number of contact points."""
        return len(self.points)

    def reachable(self, vertices: FloatArray, poses: list[ProbePose], *, margin: float) -> SkinPatch:
        """See `ContactModel.reachable`; whole faces."""
        faces = self.points.faces
        near = self._reachable_triangles(vertices, poses, margin).reshape(len(faces), -1).any(axis=1)
        return SkinPatch.of_vertices(self.skin, np.unique(faces[near]))

    def near_vertices(self, vertices: FloatArray, pose: ProbePose, cutoff: float) -> IntArray:
        """See `ContactModel.near_vertices`; all vertices of the faces with a point within `cutoff`."""
        near, _ = self._pairs(vertices, pose, cutoff)
        return np.unique(self.points.faces[np.unique(self.points.face[near])])

    def begin_step(  # type: ignore[override]
        self, vertices: FloatArray, pose: ProbePose, slip: FloatArray | None,
    ) -> FaceFrame:
        """As `ContactModel.begin_step`."""
        near, triangle = self._pairs(vertices, pose, self.config.alarm)
        corners = pose.place(self.probe.vertices)
        points, start = np.unique(near, return_index=True)
        places = self._positions(vertices, points)
        bounds = np.append(start, len(near))
        on_probe = np.array([
            _nearest(place, corners[self.probe.surface.triangles[triangle[a:b]]])
            for place, a, b in zip(places, bounds[:-1], bounds[1:], strict=True)
        ]).reshape(-1, 3)
        apart = places - on_probe
        samples = np.zeros(len(self.probe.samples), dtype=bool)
        samples[self._near(vertices, pose, self.config.alarm)[0].point] = True
        return FaceFrame(
            points, pose.local(on_probe),
            apart / np.maximum(np.linalg.norm(apart, axis=1), 1e-12)[:, None], apart,
            np.zeros((len(points), 3)) if slip is None else slip[points], samples,
        )

    def problem(  # type: ignore[override]
        self, patch: SkinPatch, pose: ProbePose, frame: FaceFrame, *, stick: float = 1.0,
    ) -> "FaceContactProblem":
        """As `ContactModel.problem`."""
        return FaceContactProblem(self, patch, pose, frame, stick=stick)

    def _positions(self, vertices: FloatArray, points: IntArray) -> FloatArray:
        some = self.points
        found: FloatArray = np.einsum("pw,pwk->pk", some.weights[points], vertices[some.faces[some.face[points]]])
        return found

    def _pairs(self, vertices: FloatArray, pose: ProbePose, cutoff: float) -> tuple[IntArray, IntArray]:
        """Points within `cutoff` of the probe's triangles, ascending, and these triangles."""
        corners = pose.place(self.probe.vertices)
        low, high = corners.min(axis=0) - cutoff, corners.max(axis=0) + cutoff
        around = vertices[self.points.faces]
        overlaps: BoolArray = (around.max(axis=1) >= low) & (around.min(axis=1) <= high)
        face = np.all(overlaps, axis=1)
        points = np.flatnonzero(face[self.points.face])
        near, triangle = close_pairs(self._positions(vertices, points), corners, self.probe.surface.triangles, cutoff)
        order = np.argsort(near, kind="stable")
        return points[near[order]], triangle[order]


class FaceContactProblem:
    """Contact as a function of the positions of a patch's vertices, for one pose of the probe."""

    def __init__(
        self, model: FaceContactModel, patch: SkinPatch, pose: ProbePose, frame: FaceFrame, *, stick: float = 1.0,
    ) -> None:
        """Place the probe; arguments as those of `ContactProblem`."""
        self.model, self.patch, self.pose, self.stick = model, patch, pose, stick
        points = model.points
        self._samples, self._corners = pose.place(model.probe.samples)[frame.samples], pose.place(model.probe.vertices)
        self._capsules = bounding_capsules(self._corners[model.probe.surface.triangles])
        local = np.full(len(model.skin.nodes), -1, dtype=np.int64)
        local[patch.vertices] = np.arange(len(patch.vertices))
        inside = np.all(local[points.faces] >= 0, axis=1)
        self._points = np.flatnonzero(inside[points.face])
        self._nodes = local[points.faces[points.face[self._points]]]
        self._weights, self._area = points.weights[self._points], points.area[self._points]
        count = len(self._points)
        self._anchored = np.zeros(count, dtype=bool)
        self._anchor_normal, self._anchor_offset = np.zeros((count, 3)), np.zeros((count, 3))
        known = np.isin(frame.points, self._points)
        at = np.searchsorted(self._points, frame.points[known])
        self._anchored[at], self._anchor_normal[at] = True, frame.normal[known]
        # Along the normal nothing counts; the point itself is p, its partner moves with the probe.
        self._anchor_offset[at] = frame.slip[known] / stick - frame.start[known] - pose.place(frame.local[known])
        self._seen_at: FloatArray | None = None
        self._offsets, self._candidates = np.zeros(count + 1, dtype=np.int64), np.empty(0, dtype=np.int64)

    def evaluate(self, positions: FloatArray, *, exact: bool = True, share: float = 1.0) -> ContactForces:
        """Energy, forces and stiffness; see `ContactProblem.evaluate`."""
        positions = np.ascontiguousarray(positions)
        self._seek_pairs(positions)
        config = self.model.config
        per_area = share * config.stiffness / config.spacing**2
        law = ContactConstants(per_area, config.smoothing, config.friction, self.stick * SLIP_SHARE * per_area)
        energy, penetration, hits, gradient, stiffness, touched, force, slip = evaluate_faces(
            positions, self._nodes, self._weights, self._area, self._offsets, self._candidates, self._corners,
            self.model.probe.surface.triangles, self._capsules, law, config.gap, self._anchored,
            self._anchor_normal, self._anchor_offset, exact,
        )
        pressed = self.patch.vertices[touched]
        return ContactForces(energy, gradient, stiffness, touched, slip, force, penetration, hits, pressed)

    def slip_everywhere(self, forces: ContactForces) -> FloatArray:
        """Elastic slip of all contact points of the skin [mm], shape (`FaceContactModel.n_points`, 3)."""
        slip = np.zeros((self.model.n_points, 3))
        slip[self._points] = self.stick * forces.slip
        return slip

    def tunnelled(self, positions: FloatArray) -> bool:
        """See `ContactProblem.tunnelled`."""
        return bool(points_beneath(self._samples, np.ascontiguousarray(positions), self.patch.triangles).any())

    def _seek_pairs(self, positions: FloatArray) -> None:
        if self._seen_at is not None and ((positions - self._seen_at) ** 2).sum(axis=1).max(initial=0.0) <= MARGIN**2:
            return
        self._seen_at = positions.copy()
        places = np.einsum("pw,pwk->pk", self._weights, positions[self._nodes])
        # A weight below zero lets a point of a six-node face move by up to 5/3 as far as its nodes.
        reach = self.model.config.gap + 5.0 / 3.0 * MARGIN
        near, triangle = close_pairs(places, self._corners, self.model.probe.surface.triangles, reach)
        self._candidates = triangle[np.argsort(near, kind="stable")]
        self._offsets = np.concatenate([[0], np.cumsum(np.bincount(near, minlength=len(places)))]).astype(np.int64)


def _nearest(point: FloatArray, triangles: FloatArray) -> FloatArray:
    """Nearest place to `point` on some triangles (k, 3, 3)."""
    corners, index = triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)
    t, wa, wb, wc, _, _ = nearest_on_probe(point, np.arange(len(index)), corners, index)
    place: FloatArray = wa * triangles[t, 0] + wb * triangles[t, 1] + wc * triangles[t, 2]
    return place
