"""Pose map: a picture of the grid of poses, coloured by what became of each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.files import atomic_path
from mixpinn.dataset.positions import plane_axes
from mixpinn.dataset.status import PoseState, PoseStatus
from mixpinn.dataset.store import SimulationStore
from mixpinn.geometry.probe_pose import probe_rotation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {
    "done": "#2a7f4f", "done, some steps failed": "#e0a030", "done, no contact": "#7f9fc0", "failed": "#b02a30",
    "missing": "#c8c8c8",
}


def pose_colour_key(status: PoseStatus) -> str:
    """Which entry of the legend a pose belongs to."""
    if status.state is not PoseState.DONE:
        return str(status.state)
    if status.failed_steps:
        return "done, some steps failed"
    return "done" if status.contact_steps else "done, no contact"


def draw_pose_map(store: SimulationStore) -> Figure:
    """One panel a rotation: each position as seen along the pressing direction, a bar along the probe's long side."""
    # Imported here: every worker process imports this package, and none of them draws.
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    direction = store.protocol.unit_direction
    axes = plane_axes(direction)
    rotations = sorted({pose.rotation_deg for pose in store.poses})
    figure = Figure(figsize=(3.2 * len(rotations) + 1.0, 4.2), layout="constrained")
    panels = figure.subplots(1, max(1, len(rotations)), squeeze=False, sharex=True, sharey=True)[0]
    keys = {pose: pose_colour_key(store.status(pose)) for pose in store.poses}
    for panel, rotation in zip(panels, rotations, strict=False):
        poses = [pose for pose in store.poses if pose.rotation_deg == rotation]
        centres = np.array([pose.position for pose in poses]) @ axes.T
        bar = axes @ probe_rotation(rotation, direction)[:, 0] * 0.33 * store.protocol.spacing
        for (x, y), pose in zip(centres, poses, strict=True):
            panel.plot(
                [x - bar[0], x + bar[0]], [y - bar[1], y + bar[1]], color=COLOURS[keys[pose]], linewidth=4.0,
                solid_capstyle="round",
            )
        panel.set_title(f"{rotation:g}°")
        panel.set_aspect("equal")
        panel.set_xlabel("x [mm]" if np.allclose(np.abs(axes[0]), [1, 0, 0]) else "across [mm]")
    panels[0].set_ylabel("z [mm]" if np.allclose(np.abs(axes[1]), [0, 0, 1]) else "along [mm]")
    panels[0].invert_yaxis()  # cranial is up: z points to the feet
    counts = {key: sum(found == key for found in keys.values()) for key in COLOURS}
    handles = [
        Line2D([], [], color=COLOURS[key], linewidth=4.0, label=f"{key} ({count})")
        for key, count in counts.items() if count
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(f"{counts['done']} of {len(store.poses)} poses complete")
    return figure


def save_pose_map(store: SimulationStore, path: Path | str) -> None:
    """Draw the pose map of `store` to a picture file (.png, .svg, .pdf)."""
    with atomic_path(path) as temporary:
        draw_pose_map(store).savefig(temporary, dpi=130)
