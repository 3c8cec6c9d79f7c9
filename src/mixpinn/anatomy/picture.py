"""The picture of a label map: three orthogonal slices with a legend."""

from pathlib import Path

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.base.arrays import AnyArray
from mixpinn.base.files import atomic_path
from mixpinn.records.label_map import LabelMap

_VIEWS = (  # title, axis across, axis down, axis looked along
    ("from behind", 0, 2, 1), ("from the patient's left", 1, 2, 0), ("from above", 0, 1, 2),
)
_AXES = ("x, right", "y, back", "z, down")
_BACKGROUND, _BODY = (1.0, 1.0, 1.0), (0.93, 0.80, 0.72)


def draw_label_map(label_map: LabelMap, path: Path | str, *, findings: tuple[Finding, ...] = ()) -> None:
    """Write a PNG of three slices through the rigid part in the middle, with the number of voxels of each structure.

    Slices run along the grid; in an oblique image they are tilted against the world's axes as the grid is.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    n_soft, n_rigid = len(label_map.soft_names), len(label_map.rigid_names)
    colours = np.array([
        _BACKGROUND, _BODY, *[matplotlib.colormaps["Pastel2"](i % 8)[:3] for i in range(n_soft - 1)],
        *[matplotlib.colormaps["tab10"](i % 10)[:3] for i in range(n_rigid)],
    ])
    spacing = np.linalg.norm(label_map.affine[:3, :3], axis=0)
    cut = _middle(label_map)
    half = 0.5 * spacing * label_map.labels.shape
    centre = (label_map.affine @ [*(0.5 * (np.array(label_map.labels.shape) - 1)), 1.0])[:3]
    low, high = centre - half, centre + half

    width, depth, _ = high - low
    figure = Figure(figsize=(15.0, 6.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3, width_ratios=[width, depth, width])
    for axis, (title, across, down, along) in zip(axes, _VIEWS, strict=True):
        plane = np.take(label_map.labels, cut[along], axis=along)
        plane = plane.T if across < down else plane
        axis.imshow(
            plane, cmap=ListedColormap(colours), vmin=-0.5, vmax=len(colours) - 0.5, interpolation="nearest",
            extent=(low[across], high[across], high[down], low[down]),
        )
        axis.set(title=title, xlabel=f"{_AXES[across]} [mm]", ylabel=f"{_AXES[down]} [mm]")
    counts = np.bincount(label_map.labels.ravel(), minlength=len(colours))
    figure.legend(
        handles=[
            Patch(facecolor=colours[label], edgecolor="0.4", label=f"{label}  {name}: {counts[label]:,} voxels")
            for label, name in enumerate(label_map.names, start=1)
        ],
        loc="outside lower center", ncols=min(4, n_soft + n_rigid), frameon=False,
    )
    figure.suptitle(_title(findings), fontsize=10)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=100)


def _middle(label_map: LabelMap) -> AnyArray:
    """Grid index of the centroid of the rigid part that is in the middle of their row, shape (3,)."""
    name = label_map.rigid_names[(len(label_map.rigid_names) - 1) // 2]
    middle: AnyArray = np.rint(np.argwhere(label_map.mask(name)).mean(axis=0)).astype(int)
    return middle


def _title(findings: tuple[Finding, ...]) -> str:
    if not findings:
        return "label check: nothing found"
    repaired = sum(finding.repaired for finding in findings)
    return f"label check: {len(findings)} findings, {repaired} repaired"
