"""Frictional contact of the rigid probe with the skin.

Method: a stiff, twice differentiable penalty on every close pair of (probe sample, skin triangle) and of (skin
vertex, probe triangle), with Coulomb friction by return mapping of an elastic slip. It was chosen over

* a logarithmic barrier, which needs a line search that never lets a pair cross and therefore many short steps where
  the probe itself moves by half the gap between two solves; and
* an augmented Lagrangian or an active set, which satisfy the gap exactly at the price of a second loop of solves,

because with a 2 mm gap the probe stays on its own side of the skin even where the penalty gives way by hundredths of
a millimetre. What makes a stiff penalty expensive, contacts that switch on one after another, costs little here: the
solve condenses the elastic body to the patch of skin that the probe can reach (`mixpinn.physics.condensed_contact`),
where an iteration takes a fraction of a millisecond. The violation of the gap is reported with every step.

Normal contact. The penalty of `mixpinn.physics.contact_law` acts along the line that joins a pair closer than the gap.
All pairs closer than the gap count, not only local
minima of the distance: the distance to one triangle has a continuous gradient everywhere, whereas a local minimum
vanishes with a jump of the force where the nearest place runs over the edge of a valley. Near an edge two triangles
share the load, which makes contact stiffer there and changes nothing else.

Friction. For each contact point the relative tangential motion Δs since the start of the step is measured between
two material points chosen at the start of the step. The elastic slip e = e₀ + Δs is mapped back to Coulomb's cone by
the same law, and at the end of the step e₀ is what is left of it. N is that of the current iterate, its derivative
included in the stiffness.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.base.sensible import not_negative, positive, require_settings
from mixpinn.fem.contact.surfaces import SkinPatch, SkinSurface
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.geometry.probe_surface import ProbeSurface
from mixpinn.geometry.proximity import Proximity, proximity
from mixpinn.geometry.triangle_search import points_inside, triangles_within

if TYPE_CHECKING:
    from mixpinn.fem.contact.problem import ContactProblem


@dataclass(frozen=True)
class ContactConfig:
    """How the probe touches the skin.

    Attributes:
        gap: distance at which contact acts [mm].
        alarm: distance within which nodes are listed as near [mm].
        friction: Coulomb's coefficient μ.
        stiffness: k of one contact point [N/mm].
        smoothing: δ, the violation over which the contact stiffness sets in [mm].
        spacing: largest distance between neighbouring contact points on the probe [mm].
        dragging: whether friction resists motion relative to the moving probe. False is SOFA's way: its probe is set
            from place to place without a velocity, so that friction resists the skin's own motion in space.
    """

    gap: float = 2.0
    alarm: float = 4.0
    friction: float = 1.0
    stiffness: float = 500.0
    smoothing: float = 0.02
    spacing: float = 2.0
    dragging: bool = True

    def __post_init__(self) -> None:
        require_settings(self, "contact", {
            **not_negative(self, "gap", "alarm", "friction"), **positive(self, "stiffness", "smoothing", "spacing"),
        })


@dataclass(frozen=True, eq=False)
class FrictionFrame:
    """What friction refers to during one step; one entry for each contact point (probe sample or skin vertex).

    Attributes:
        anchored: contact points that were near at the start of the step, shape (p,).
        vertices: skin vertices of the material point, shape (p, 3).
        weights: their weights, shape (p, 3).
        local: material point of the probe in its own frame [mm], shape (p, 3).
        normal: unit normal at the start of the step, from probe to skin, shape (p, 3).
        start: relative position skin − probe at the start of the step [mm], shape (p, 3).
        slip: elastic slip carried into the step [mm], shape (p, 3).
    """

    anchored: BoolArray
    vertices: IntArray
    weights: FloatArray
    local: FloatArray
    normal: FloatArray
    start: FloatArray
    slip: FloatArray


@dataclass(frozen=True, eq=False)
class ContactModel:
    """Contact of one probe with one skin.

    Contact points are numbered: the probe's samples first, then the skin's vertices.
    """

    skin: SkinSurface
    probe: ProbeSurface
    config: ContactConfig = field(default_factory=ContactConfig)

    @property
    def n_points(self) -> int:
        """Number of contact points."""
        return len(self.probe.samples) + len(self.skin.nodes)

    def reachable(self, vertices: FloatArray, poses: list[ProbePose], *, margin: float) -> SkinPatch:
        """The triangles that come within `margin` [mm] of the probe in any of `poses`.

        Args:
            vertices: skin vertex positions [mm], shape (v, 3).
            poses: of the probe.
            margin: distance that counts as near [mm].
        """
        near = self._reachable_triangles(vertices, poses, margin)
        return SkinPatch.of_vertices(self.skin, np.unique(self.skin.surface.triangles[near]))

    def _reachable_triangles(self, vertices: FloatArray, poses: list[ProbePose], margin: float) -> BoolArray:
        near = np.zeros(len(self.skin.surface.triangles), dtype=bool)
        for pose in poses:
            open_ones = np.flatnonzero(~near)
            triangles = self.skin.surface.triangles[open_ones]
            near[open_ones] = triangles_within(pose.place(self.probe.samples), vertices, triangles, margin)
        return near

    def near_vertices(self, vertices: FloatArray, pose: ProbePose, cutoff: float) -> IntArray:
        """Skin vertices at the nearest places of contact points within `cutoff` [mm], ascending."""
        first, second = self._near(vertices, pose, cutoff)[:2]
        used = self.skin.surface.triangles[first.triangle][first.weights > 0.0]
        return np.unique(np.concatenate([used, second.point]))

    def clearance(self, vertices: FloatArray, pose: ProbePose) -> tuple[int, float]:
        """Number of probe samples inside the skin, and the smallest distance of any contact point [mm].

        The distance is infinite beyond the alarm distance; the skin must be closed for the first to mean anything.
        """
        samples = pose.place(self.probe.samples)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        within = ((samples >= low) & (samples <= high)).all(axis=1)
        inside = points_inside(samples[within], np.ascontiguousarray(vertices), self.skin.surface.triangles)
        first, second = self._near(vertices, pose, self.config.alarm)[:2]
        return int(inside.sum()), float(min(first.distance.min(initial=np.inf), second.distance.min(initial=np.inf)))

    def begin_step(self, vertices: FloatArray, pose: ProbePose, slip: FloatArray | None) -> FrictionFrame:
        """Choose the material points that friction refers to, from the configuration at the start of a step.

        Args:
            vertices: skin vertex positions [mm], shape (v, 3).
            pose: of the probe, at the start of the step.
            slip: elastic slip at the end of the previous step [mm], shape (p, 3), or None at first.
        """
        n = self.n_points
        frame = FrictionFrame(
            np.zeros(n, dtype=bool), np.zeros((n, 3), dtype=np.int64), np.zeros((n, 3)), np.zeros((n, 3)),
            np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)) if slip is None else slip,
        )
        first, second, samples, corners = self._near(vertices, pose, self.config.alarm)
        stencil = np.concatenate([
            self.skin.surface.triangles[first.triangle], np.repeat(second.point[:, None], 3, axis=1),
        ])
        weights = np.concatenate([first.weights, np.tile([1.0, 0.0, 0.0], (len(second), 1))])
        on_probe = np.concatenate([
            samples[first.point],
            np.einsum("hc,hck->hk", second.weights, corners[self.probe.surface.triangles[second.triangle]]),
        ])
        apart = np.einsum("hc,hck->hk", weights, vertices[stencil]) - on_probe
        distance = np.concatenate([first.distance, second.distance])
        key = np.concatenate([first.point, len(self.probe.samples) + second.point])
        order = np.argsort(-distance, kind="stable")  # the nearest pair of a contact point is written last
        key = key[order]
        frame.anchored[key] = True
        frame.vertices[key], frame.weights[key] = stencil[order], weights[order]
        frame.local[key] = pose.local(on_probe)[order]
        frame.normal[key] = (apart / np.maximum(distance, 1e-12)[:, None])[order]
        frame.start[key] = apart[order]
        return frame

    def problem(
        self, patch: SkinPatch, pose: ProbePose, frame: FrictionFrame, *, stick: float = 1.0,
    ) -> "ContactProblem":
        """Contact with a patch of the skin for one pose of the probe, as what a load step solves against.

        With `stick` points stick by that share of their stiffness before they slide.
        """
        from mixpinn.fem.contact.problem import ContactProblem

        return ContactProblem(self, patch, pose, frame, stick=stick)

    def _near(
        self, vertices: FloatArray, pose: ProbePose, cutoff: float,
    ) -> tuple[Proximity, Proximity, FloatArray, FloatArray]:
        """Pairs within `cutoff`: probe samples against skin, skin vertices against probe; samples and placed probe."""
        samples, corners = pose.place(self.probe.samples), pose.place(self.probe.vertices)
        first = proximity(samples, vertices, self.skin.surface, cutoff=cutoff)
        low, high = corners.min(axis=0) - cutoff, corners.max(axis=0) + cutoff
        close = np.flatnonzero(((vertices >= low) & (vertices <= high)).all(axis=1))
        second = proximity(vertices[close], corners, self.probe.surface, cutoff=cutoff)
        second = Proximity(close[second.point], second.triangle, second.weights, second.distance)
        return first, second, samples, corners
