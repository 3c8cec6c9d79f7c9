"""One picture of what a body is made of: layers, bones, joints and supports, in a lengthwise and a cross section."""

from pathlib import Path

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.files import atomic_path
from mixpinn.evaluation.metrics import part_label
from mixpinn.physics.foundation import FoundationSystem
from mixpinn.physics.restraints import Restraints
from mixpinn.records import TissueMesh

_TISSUES = ("#F0D3C0", "#F7E9A0", "#D98A80", "#C4A484", "#B9C6D9", "#C9D8B6", "#D9C2DE", "#E3B9A0")
_AXES = (("right", "#ee6677"), ("back", "#228833"), ("caudal", "#4477aa"))


def draw_body(mesh: TissueMesh, restraints: Restraints, path: Path | str, *, axis_length: float = 15.0) -> None:
    """Draw tissues in colours, bones each in its own (hatched where held), joints by their axes, what holds the skin.

    Args:
        mesh: the mesh.
        restraints: joints and foundations.
        path: of a ``.png``.
        axis_length: of a joint's axis [mm].
    """
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    bones = mesh.target_points
    centre = 0.5 * (bones.min(axis=0) + bones.max(axis=0))
    colours = [colormaps["tab20"](k % 20) for k in range(mesh.n_parts)]
    pad = FoundationSystem(restraints.foundations, mesh).nodes
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    sections = ((0, 1, 2, "y, to the back [mm]", "z, caudal [mm]"), (2, 0, 1, "x, to the right [mm]", "y [mm]"))
    for plot, (normal, across, up, label, other) in zip(figure.subplots(1, 2), sections, strict=True):
        polygons, cells = cut_cells(mesh.points, mesh.cells, axis=normal, place=float(centre[normal]))
        plot.add_collection(PolyCollection(
            [polygon[:, [across, up]] for polygon in polygons],
            facecolors=[_TISSUES[int(t) % len(_TISSUES)] for t in mesh.tissue[cells]], edgecolors="0.75",
            linewidths=0.1,
        ))
        for k in range(mesh.n_parts):
            ends = mesh.points[mesh.edges[mesh.edge_part == k + 1]][:, :, [across, up]]
            lines = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
            plot.plot(*lines.T, color=colours[k], linewidth=0.35, linestyle=":" if mesh.held_parts[k] else "-")
        for nodes, mark, colour in ((_near(mesh, mesh.node_fixed & (mesh.node_part == 0), normal, centre), "^", "k"),
                                    (_near(mesh, _mask(pad, mesh.n_nodes), normal, centre), "s", "#2C7FB8")):
            plot.plot(*mesh.node_points[nodes][:, [across, up]].T, mark, color=colour, markersize=3.0)
        for joint in restraints.joints:
            for (_, colour), axis in zip(_AXES, np.array(joint.frame.axes), strict=True):
                way = np.stack([joint.frame.centre, joint.frame.centre + axis_length * axis])
                plot.plot(*way[:, [across, up]].T, color=colour, linewidth=1.8)
        plot.set(xlabel=label, ylabel=other, aspect="equal")
        plot.autoscale_view()
        if up == 2:
            plot.invert_yaxis()
    shown: list[Patch | Line2D] = [
        Patch(color=_TISSUES[t % len(_TISSUES)], label=name) for t, name in enumerate(mesh.tissue_names)
    ]
    shown += [
        Line2D([], [], color=colours[k], linestyle=":" if mesh.held_parts[k] else "-",
               label=part_label(name) + (" (held)" if mesh.held_parts[k] else ""))
        for k, name in enumerate(mesh.rigid_names)
    ]
    if restraints.joints:
        shown += [Line2D([], [], color=colour, linewidth=2.0, label=f"joint, {name}") for name, colour in _AXES]
    if (mesh.fixed & (mesh.part == 0)).any():
        shown.append(Line2D([], [], color="k", marker="^", linestyle="", label="held in place"))
    if len(pad):
        shown.append(Line2D([], [], color="#2C7FB8", marker="s", linestyle="", label="on a foundation"))
    figure.legend(handles=shown, loc="outside right upper", frameon=False, fontsize=7)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110, format="png")


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


def _mask(nodes: IntArray, size: int) -> AnyArray:
    mask = np.zeros(size, dtype=bool)
    mask[nodes] = True
    return mask


def _near(mesh: TissueMesh, chosen: AnyArray, axis: int, centre: FloatArray, within: float = 20.0) -> IntArray:
    """Chosen nodes within some millimetres of the section."""
    nodes: IntArray = np.flatnonzero(chosen & (np.abs(mesh.node_points[:, axis] - centre[axis]) <= within))
    return nodes
