"""Cells that are finer under the probe, and what is left of the error of their size.

Most of what a pose misses on a mesh is missed where the probe's edge meets the skin: a face that is half under the
probe cannot follow both it and the skin beside it, and the faces around take part in the load. So the cells around the
path of the probe are halved (`mixpinn.mesh.refine_to`) until no edge is longer than

    h(x) = edge + growth · d(x),

with d the distance from the skin that the probe meets. The facets stay.

Under the rim of a rigid tool the displacement of the skin goes like the root of the distance r from the rim, as under a
punch with an edge, and its gradient like 1/√r. What cells of size h cannot follow there has an energy of about
∫₀ʰ (1/√r)² r dr = h: the error falls with the edge length itself, whatever the order of the cells. Two fields of edge
lengths, one q times the other everywhere, then tell the value without an error of that kind:

    u = u(h) + (u(h) − u(q h)) / (q − 1).

How well that holds on a patient is measured by ``python -m benchmarks.truth``.
"""

from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.sensible import not_negative, positive, require_settings
from mixpinn.mesh.cells.bisect import refine_to
from mixpinn.physics.face_points import FacePoints
from mixpinn.records import Probe, ProbePath, TissueMesh

_SPACING = 3.0
"""Of the points on the skin that tell how far up it reaches beside a probe [mm]."""

_DEEPEST = 60.0
"""Skin farther above a probe's tip is not what it has pushed away [mm]."""

_GROWTH = 0.05
"""Of the edge length with the distance from the probe, as a share of that under it, per mm."""


@dataclass(frozen=True)
class LocalRefinement:
    """How fine cells are around the path of a probe.

    Attributes:
        edge: longest edge under the probe [mm].
        growth: by how much longer an edge may be for each mm that it lies farther away.
        extrapolated: whether each pose is also solved with longer edges, and told as what both tend to.
        ratio: q, how many times as long they are.
    """

    edge: float = 10.0
    growth: float = _GROWTH * 10.0
    extrapolated: bool = True
    ratio: float = 2.0

    def __post_init__(self) -> None:
        require_settings(self, "refinement", {
            **positive(self, "edge"), **not_negative(self, "growth"),
            "ratio": (1.2 <= self.ratio <= 4.0, "1.2 to 4: closer lengths tell noise, others too little"),
        })

    def scaled(self, factor: float) -> "LocalRefinement":
        """With h `factor` times as long everywhere."""
        return replace(self, edge=factor * self.edge, growth=factor * self.growth)

    def __str__(self) -> str:
        """In words; how edges grow away from the probe where it is not as usual."""
        usual = abs(self.growth - _GROWTH * self.edge) <= 1e-9 * self.edge
        grown = "" if usual else f" growing by {self.growth:g} mm a mm,"
        if not self.extrapolated:
            return f"edges of {self.edge:g} mm{grown}"
        return f"edges of {self.ratio * self.edge:g} and {self.edge:g} mm,{grown} extrapolated,"


def refine_under(mesh: TissueMesh, probe: Probe, path: ProbePath, config: LocalRefinement) -> TissueMesh:
    """`mesh` with finer cells around the skin that `probe` meets on `path`; the vertices of `mesh` come first.

    That skin lies in boxes that stand on the probe's tip, one at each pose: as wide as the probe is as far up as skin
    reaches, and as high.

    Args:
        mesh: of either order.
        probe: the tool.
        path: its poses.
        config: how fine.
    """
    spots = FacePoints.build(mesh.skin_faces, mesh.points[mesh.skin_faces], spacing=_SPACING)
    skin = np.einsum("pw,pwk->pk", spots.weights, mesh.points[spots.vertices])
    span = np.linalg.norm(probe.points, axis=1).max() + _DEEPEST
    low, high = path.translations.min(axis=0) - span, path.translations.max(axis=0) + span
    skin = skin[((skin >= low) & (skin <= high)).all(axis=1)]
    boxes = [_box(skin, probe, turn, tip) for turn, tip in zip(path.rotations, path.translations, strict=True)]

    def length(points: FloatArray) -> FloatArray:
        away = np.full(len(points), np.inf)
        for turn, tip, (low, high) in zip(path.rotations, path.translations, boxes, strict=True):
            local = (points - tip) @ turn
            away = np.minimum(away, np.linalg.norm(local - np.clip(local, low, high), axis=1))
        found: FloatArray = config.edge + config.growth * away
        return found

    return refine_to(mesh.with_order(1), length).with_order(mesh.order)


def _box(skin: FloatArray, probe: Probe, rotation: FloatArray, tip: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the resting skin lies that a placed probe has pushed away, in its frame: corners of a box [mm], (3,)."""
    local, bottom = (skin - tip) @ rotation, float(probe.points[:, 1].min())
    low, high = probe.points.min(axis=0), probe.points.max(axis=0)
    beneath = ((local >= low) & (local <= high))[:, [0, 2]].all(axis=1) & (local[:, 1] <= bottom + _DEEPEST)
    height = float(local[beneath, 1].max(initial=bottom))  # it may be above all of the probe
    part = probe.points[probe.points[:, 1] <= height + 1.0]
    low, high = part.min(axis=0), part.max(axis=0)
    low[1], high[1] = bottom, height
    return low, high
