"""Cells that are finer under the probe, and what is left of the error of their size.

Most of what a pose misses on a mesh is missed where the probe's edge meets the skin: a face that is half under the
probe cannot follow both it and the skin beside it, and the faces around take part in the load. So the cells around the
path of the probe are halved (`mixpinn.mesh.refine_to`) until no edge is longer than

    h(x) = edge + growth · d(x),

with d the distance from the resting skin that the probe meets. The facets stay.

Two fields of edge lengths, one q times the other everywhere, tell more than either: where the error falls like hᵖ,

    u = u(h) + (u(h) − u(q h)) / (qᵖ − 1).

Under the rim of a sharp tool the displacement of the skin goes like the root of the distance r from the rim, as under a
punch with an edge, and its gradient like 1/√r. What cells of size h cannot follow there has an energy of about
∫₀ʰ (1/√r)² r dr = h: p = 1, whatever the order of the cells. Under a rounded edge the gradient is bounded, and what is
missed is missed at the border of contact, where the gradient goes on like √r: an energy of ∫₀ʰ (√r)² r dr ~ h³. Cells
longer than the edge is round are between the two. From 20 to 7 mm p = 2.25 tells best what rounded tools tend to.
`rim_order` tells which of them a tool has; how well it holds on a patient is measured by
``python -m benchmarks.truth``. What is missed far from the probe, along the border of the held skin, is corrected
otherwise (`mixpinn.fem.solve.held_border`).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.sensible import not_negative, positive, require_settings
from mixpinn.mesh.cells.bisect import refine_to
from mixpinn.mesh.meshers.grading import surface_points
from mixpinn.mesh.surfaces.surface import Surface
from mixpinn.records import Probe, ProbePath, TissueMesh
from mixpinn.records.probe_valleys import turns

_SPACING = 2.0
"""Of the points on the skin that tell how far up it reaches beside a probe [mm]."""

_DEEPEST = 60.0
"""Skin farther above a probe's tip is not what it has pushed away [mm]."""

_MARGIN = 1.0
"""Skin so far beside a probe still counts as under it [mm]."""

_SHARP = 35.0
"""An edge at which the surface turns by more is sharp [degree]; rounded ones turn a little at each of many."""

_LOWEST = 6.0
"""Edges of a tool farther above its tip do not meet skin first [mm]."""

_SHARP_ORDER, _ROUNDED_ORDER = 1.0, 2.25
"""Order with which the error of cells under a tool falls, by its edges; the latter is measured, see above."""

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
        order: p, of what is left of the error; None takes that of the tool, `rim_order`.
        held: edge along the border of the held skin down to which an extrapolated pose is corrected
            (`mixpinn.fem.solve.held_border`) [mm]; None leaves what cells there miss.
    """

    edge: float = 10.0
    growth: float = _GROWTH * 10.0
    extrapolated: bool = True
    ratio: float = 2.0
    order: float | None = None
    held: float | None = 6.0

    def __post_init__(self) -> None:
        require_settings(self, "refinement", {
            **positive(self, "edge"), **not_negative(self, "growth"),
            "ratio": (1.2 <= self.ratio <= 4.0, "1.2 to 4: closer lengths tell noise, others too little"),
            "held": (self.held is None or self.held > 0.0, "above zero, or none"),
            "order": (self.order is None or 0.5 <= self.order <= 4.0, "0.5 to 4, or none for that of the tool"),
        })

    def scaled(self, factor: float) -> "LocalRefinement":
        """With h `factor` times as long everywhere."""
        return replace(self, edge=factor * self.edge, growth=factor * self.growth)

    def of_tool(self, probe: Probe) -> "LocalRefinement":
        """With the order of a tool, where none is given."""
        return self if self.order is not None or not self.extrapolated else replace(self, order=rim_order(probe))

    def __str__(self) -> str:
        """In words; how edges grow away from the probe where it is not as usual."""
        usual = abs(self.growth - _GROWTH * self.edge) <= 1e-9 * self.edge
        grown = "" if usual else f" growing by {self.growth:g} mm a mm,"
        if not self.extrapolated:
            return f"edges of {self.edge:g} mm{grown}"
        held = "" if self.held is None else "held border corrected, "
        return f"{held}edges of {self.ratio * self.edge:g} and {self.edge:g} mm,{grown} extrapolated,"


def rim_order(probe: Probe) -> float:
    """Order p in the edge length with which cells under a tool err: 1 for sharp edges, 2.25 for rounded."""
    at = turns(probe.points, probe.triangles)
    sharp = ~at.concave & (at.angle > _SHARP) & (at.height <= probe.points[:, 1].min() + _LOWEST)
    return _SHARP_ORDER if sharp.any() else _ROUNDED_ORDER


def refine_under(mesh: TissueMesh, probe: Probe, path: ProbePath, config: LocalRefinement) -> TissueMesh:
    """`mesh` with finer cells around the skin that `probe` meets on `path`; the vertices of `mesh` come first.

    That is the resting skin in boxes that stand on the probe's tip, one at each pose: as wide as the probe is as far up
    as skin reaches, and as high.

    Args:
        mesh: of either order.
        probe: the tool.
        path: its poses.
        config: how fine.
    """
    skin = _skin_points(mesh, mesh.skin_faces)
    span = np.linalg.norm(probe.points, axis=1).max() + _DEEPEST
    low, high = path.translations.min(axis=0) - span, path.translations.max(axis=0) + span
    skin = skin[((skin >= low) & (skin <= high)).all(axis=1)]
    met = np.zeros(len(skin), dtype=bool)
    for turn, tip in zip(path.rotations, path.translations, strict=True):
        low, high = _box(skin, probe, turn, tip)
        local = (skin - tip) @ turn
        met |= ((local >= low - _MARGIN) & (local <= high + _MARGIN)).all(axis=1)
    return refine_around(mesh, skin[met], edge=config.edge, growth=config.growth)


def refine_skin(mesh: TissueMesh, faces: IntArray, config: LocalRefinement) -> TissueMesh:
    """`mesh` with finer cells around all of some `faces` (t, 3) of its skin; the vertices of `mesh` come first."""
    return refine_around(mesh, _skin_points(mesh, faces), edge=config.edge, growth=config.growth)


def _skin_points(mesh: TissueMesh, faces: IntArray) -> FloatArray:
    """Points on faces (t, 3) of a mesh [mm], shape (p, 3)."""
    nodes, own = np.unique(faces, return_inverse=True)
    return surface_points(Surface("skin", mesh.points[nodes], own.reshape(-1, 3)), _SPACING)


def refine_around(mesh: TissueMesh, points: FloatArray, *, edge: float, growth: float) -> TissueMesh:
    """`mesh` with cells halved until no edge is longer than `edge` [mm] and `growth` times the distance from `points`.

    The vertices of `mesh` come first; `points` have shape (p, 3) [mm].
    """
    nearest = cKDTree(points)

    def length(places: FloatArray) -> FloatArray:
        found: FloatArray = edge + growth * nearest.query(places)[0]
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
