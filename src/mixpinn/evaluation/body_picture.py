"""One picture of what a body is made of: layers, bones, joints and supports, in a lengthwise and a cross section."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.anatomy.mixture import mixed_parts
from mixpinn.anatomy.names import tissue_group
from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.files import atomic_path
from mixpinn.evaluation.metrics import part_label
from mixpinn.physics.foundation import FoundationSystem
from mixpinn.physics.restraints import Restraints
from mixpinn.records import TissueMesh
from mixpinn.records.joint_frame import JointFrame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

_TISSUES = ("#F0D3C0", "#C4A484", "#C9D8B6", "#D9C2DE", "#E3B9A0")
_GROUPS = {"fat": "#F7E9A0", "muscle": "#D98A80", "disc": "#B9C6D9", "organ": "#B08968"}
_AXES = (("right", "#CC3311"), ("back", "#009944"), ("caudal", "#0055AA"))
_BONE, _BEHIND, _HATCH = "#FFFDF2", "0.45", "//////"
_NEAR = 20.0
"""Joints and held nodes are shown in a section that they lie no farther from [mm]."""


@dataclass(frozen=True)
class _Section:
    """A plane across one axis, and which way it is looked at."""

    normal: int
    across: int
    up: int
    labels: tuple[str, str]
    title: str


_SECTIONS = (
    _Section(0, 1, 2, ("y, to the back [mm]", "z, caudal [mm]"), "lengthwise, at x = {:.0f} mm"),
    _Section(2, 0, 1, ("x, to the right [mm]", "y, to the back [mm]"), "across, at z = {:.0f} mm"),
)


def draw_body(mesh: TissueMesh, restraints: Restraints, path: Path | str, *, axis_length: float = 15.0) -> None:
    """Draw what the body is made of in two sections through the middle of the targets.

    Tissues are filled in colours, bones in white where the section cuts them (hatched where they are held) and as a
    faint net where they lie before or behind it; joints are shown by their axes, and what holds the skin by marks.

    Args:
        mesh: the mesh.
        restraints: joints and foundations.
        path: of a ``.png``.
        axis_length: of a joint's axis [mm].
    """
    from matplotlib.figure import Figure

    targets = mesh.target_points
    centre = 0.5 * (targets.min(axis=0) + targets.max(axis=0))
    extent = np.ptp(mesh.points, axis=0)
    figure = Figure(figsize=(11.0, 6.5), layout="constrained")
    wide = [extent[section.across] / extent[section.up] for section in _SECTIONS]
    plots = figure.subplots(1, 2, width_ratios=wide)
    for plot, section in zip(plots, _SECTIONS, strict=True):
        place = float(centre[section.normal])
        plot.set_title(section.title.format(place), fontsize=9)
        _draw_tissues(plot, mesh, section, place)
        _draw_bones(plot, mesh, section, place)
        _draw_supports(plot, mesh, restraints, section, place)
        for joint in restraints.joints:
            if abs(joint.frame.centre[section.normal] - place) <= _NEAR:
                _draw_joint(plot, joint.frame, section, axis_length)
        plot.set(xlabel=section.labels[0], ylabel=section.labels[1], aspect="equal")
        plot.autoscale_view()
        if section.up == 2:
            plot.invert_yaxis()
    figure.legend(
        handles=_legend(mesh, restraints), loc="outside lower center", frameon=False, fontsize=8, ncols=5,
    )
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110, format="png")


def tissue_colours(names: Sequence[str]) -> FloatArray:
    """Colour of each tissue, fat, muscle, discs and organs always the same and mixtures between, shape (T, 3)."""
    from matplotlib.colors import to_rgb

    pure = [name for name in names if len(mixed_parts(name)) == 1 and tissue_group(name) is None]

    def colour(name: str) -> FloatArray:
        place = pure.index(name) if name in pure else 0
        return np.array(to_rgb(_GROUPS.get(tissue_group(name) or "", _TISSUES[place % len(_TISSUES)])))

    return np.array([sum(share * colour(part) for part, share in mixed_parts(name)) for name in names])


def _draw_tissues(plot: "Axes", mesh: TissueMesh, section: _Section, place: float) -> None:
    from matplotlib.collections import PolyCollection

    polygons, cells = cut_cells(mesh.points, mesh.cells, axis=section.normal, place=place)
    colours = tissue_colours(mesh.tissue_names)[mesh.tissue[cells]]
    flat = [polygon[:, [section.across, section.up]] for polygon in polygons]
    plot.add_collection(PolyCollection(flat, facecolors=colours, edgecolors=colours, linewidths=0.3))


def _draw_bones(plot: "Axes", mesh: TissueMesh, section: _Section, place: float) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    flat = [section.across, section.up]
    faces = mesh.boundary_faces
    for k, name in enumerate(mesh.rigid_names):
        ends = mesh.points[mesh.edges[mesh.edge_part == k + 1]][:, :, flat]
        lines = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        plot.plot(*lines.T, color=_BEHIND, linewidth=0.15, alpha=0.6)
        own = faces[(mesh.part[faces] == k + 1).all(axis=1)]
        loops = [loop[:, flat] for loop in cut_surface(mesh.points, own, axis=section.normal, place=place)]
        if loops:
            outline = Outline.make_compound_path(*(Outline(np.vstack([loop, loop[:1]]), closed=True) for loop in loops))
            plot.add_patch(PathPatch(
                outline, facecolor=_BONE, edgecolor="k", linewidth=0.8, hatch=_HATCH if mesh.held_parts[k] else None,
                zorder=2.5,
            ))
        if not loops:
            continue
        spot = max(loops, key=lambda loop: float(np.ptp(loop, axis=0).prod())).mean(axis=0)
        plot.text(
            float(spot[0]), float(spot[1]), part_label(name), fontsize=7, ha="center", va="center", zorder=9,
            clip_on=True, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8},
        )


def _draw_supports(
    plot: "Axes", mesh: TissueMesh, restraints: Restraints, section: _Section, place: float,
) -> None:
    pad = np.zeros(mesh.n_nodes, dtype=bool)
    pad[FoundationSystem(restraints.foundations, mesh).nodes] = True
    near = np.abs(mesh.node_points[:, section.normal] - place) <= _NEAR
    for chosen, (mark, colour) in ((mesh.node_fixed & (mesh.node_part == 0), _HELD), (pad, _PAD)):
        plot.plot(
            *mesh.node_points[chosen & near][:, [section.across, section.up]].T, mark, color=colour, markersize=4.0,
            zorder=4,
        )


def _draw_joint(plot: "Axes", frame: JointFrame, section: _Section, length: float) -> None:
    flat = [section.across, section.up]
    for (_, colour), axis in zip(_AXES, np.array(frame.axes), strict=True):
        way = np.stack([frame.centre, frame.centre + length * axis])[:, flat]
        plot.plot(*way.T, color="white", linewidth=3.6, zorder=6, solid_capstyle="round")
        plot.plot(*way.T, color=colour, linewidth=2.0, zorder=7, solid_capstyle="round")
    plot.plot(*frame.centre[flat], "o", color="k", markersize=4.0, zorder=8)


_HELD, _PAD = ("^", "k"), ("s", "#2C7FB8")


def _legend(mesh: TissueMesh, restraints: Restraints) -> "list[Patch | Line2D]":
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    shown: list[Patch | Line2D] = [
        Patch(color=tuple(colour), label=name)
        for name, colour in zip(mesh.tissue_names, tissue_colours(mesh.tissue_names), strict=True)
        if len(mixed_parts(name)) == 1
    ]
    held = mesh.held_parts
    if not held.all():
        shown.append(Patch(facecolor=_BONE, edgecolor="k", label="bone"))
    if held.any():
        shown.append(Patch(facecolor=_BONE, edgecolor="k", hatch=_HATCH, label="bone, held"))
    if restraints.joints:
        shown += [Line2D([], [], color=colour, linewidth=2.0, label=f"joint: {name}") for name, colour in _AXES]
    if (mesh.fixed & (mesh.part == 0)).any():
        shown.append(Line2D([], [], color=_HELD[1], marker=_HELD[0], linestyle="", label="tissue held in place"))
    if restraints.foundations:
        shown.append(Line2D([], [], color=_PAD[1], marker=_PAD[0], linestyle="", label="skin on a foundation"))
    return shown


def cut_surface(points: FloatArray, faces: IntArray, *, axis: int, place: float) -> list[FloatArray]:
    """Where a plane across one axis cuts closed surfaces.

    Args:
        points: [mm], shape (n, 3).
        faces: triangles of closed surfaces, shape (f, 3).
        axis: normal of the plane.
        place: of the plane along it [mm].

    Returns:
        The outlines, each once round [mm], shapes (k, 3).
    """
    height = points[:, axis] - place
    height[height == 0.0] = 1e-9
    above = height[faces] > 0.0
    cut = above.any(axis=1) & ~above.all(axis=1)
    beside: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face, side in zip(faces[cut].tolist(), above[cut], strict=True):
        lone = int(np.flatnonzero(side == (side.sum() == 1))[0])
        first, second = (
            (min(face[lone], face[other]), max(face[lone], face[other])) for other in range(3) if other != lone
        )
        beside.setdefault(first, []).append(second)
        beside.setdefault(second, []).append(first)
    loops = []
    while beside:
        edge: tuple[int, int] | None = next(iter(beside))
        loop = []
        while edge is not None:
            loop.append(edge)
            edge = next((following for following in beside.pop(edge) if following in beside), None)
        a, b = np.array(loop).T
        share = height[a] / (height[a] - height[b])
        loops.append(points[a] + share[:, None] * (points[b] - points[a]))
    return loops


def cut_cells(points: FloatArray, cells: AnyArray, *, axis: int, place: float) -> tuple[list[FloatArray], IntArray]:
    """Where a plane across one axis cuts tetrahedra.

    Args:
        points: [mm], shape (n, 3).
        cells: shape (m, 4).
        axis: normal of the plane.
        place: of the plane along it [mm].

    Returns:
        The polygons, three or four corners each [mm], shapes (k, 3), in order round their edge, and the cell of each.
    """
    height = points[:, axis] - place
    height[height == 0.0] = 1e-9
    above = height[cells] > 0.0
    cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    polygons = []
    for cell, side in zip(np.asarray(cells)[cut], above[cut], strict=True):
        up, down = cell[side], cell[~side]
        pairs = [(a, b) for a in up for b in down]
        if len(pairs) == 4:
            pairs[2], pairs[3] = pairs[3], pairs[2]  # round the edge
        ends = np.array(pairs)
        share = height[ends[:, 0]] / (height[ends[:, 0]] - height[ends[:, 1]])
        polygons.append(points[ends[:, 0]] + share[:, None] * (points[ends[:, 1]] - points[ends[:, 0]]))
    return polygons, cut
