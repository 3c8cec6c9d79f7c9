"""A picture of joint frames: the vertebrae from the side and from behind, each joint with its axes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mixpinn.base.files import atomic_path
from mixpinn.records.joint_frame import JointFrame
from mixpinn.records.tissue_mesh import TissueMesh

_AXES = (("right", "#ee6677"), ("back", "#228833"), ("caudal", "#4477aa"))


def draw_joint_frames(
    mesh: TissueMesh, frames: Sequence[JointFrame], path: Path | str, *, length: float = 18.0,
) -> None:
    """Draw the surfaces of the rigid parts in the sagittal and the coronal plane, with the joints' axes, to a ``.png``.

    Args:
        mesh: the mesh.
        frames: joints of its parts.
        path: of the picture.
        length: of an axis in the picture [mm].
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.5), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    edges = mesh.edges[mesh.edge_part > 0]
    for plot, across, label in ((left, 1, "y, to the back [mm]"), (right, 0, "x, to the right [mm]")):
        ends = mesh.points[edges][:, :, [across, 2]]
        lines = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        plot.plot(*lines.T, color="0.8", linewidth=0.4)
        for frame in frames:
            for (name, colour), axis in zip(_AXES, np.array(frame.axes), strict=True):
                tip = frame.centre + length * axis
                plot.plot(
                    [frame.origin[across], tip[across]], [frame.origin[2], tip[2]], color=colour, linewidth=1.8,
                    label=name if frame is frames[0] else None,
                )
            plot.annotate(frame.name.replace("vertebrae_", ""), (frame.origin[across], frame.origin[2]), fontsize=8,
                          xytext=(-6, 0), textcoords="offset points", ha="right", va="center")
        plot.set(xlabel=label, aspect="equal")
    left.set(ylabel="z, caudal [mm]")
    left.invert_yaxis()
    if frames:
        left.legend(frameon=False, fontsize=8, loc="upper right")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110, format="png")
