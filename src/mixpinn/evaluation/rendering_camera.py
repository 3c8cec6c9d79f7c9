"""Camera, light and file of a three-dimensional picture: parallel projection that is framed on given points."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyvista as pv

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.files import atomic_path
from mixpinn.evaluation.rendering_backend import start_rendering


def new_plotter(size: tuple[int, int], *, shape: tuple[int, int] = (1, 1)) -> pv.Plotter:
    """An empty white off-screen plotter of `size` pixels without lights.

    Raises:
        RenderingUnavailable: this machine cannot draw.
    """
    start_rendering()
    plotter = pv.Plotter(off_screen=True, shape=shape, window_size=size, border=False, lighting="none")
    plotter.set_background("white", all_renderers=True)
    return plotter


def aim(
    plotter: pv.Plotter, points: AnyArray, view: Sequence[float] | FloatArray, *,
    up: Sequence[float] = (0.0, 1.0, 0.0), margin_right: float = 0.0,
) -> None:
    """Look from direction `view` in parallel projection so that `points` fill the picture, and light the scene.

    Args:
        plotter: with its active subplot.
        points: what must be visible [mm], shape (p, 3).
        view: from the scene towards the camera.
        up: what is upward in the picture.
        margin_right: part of the width kept free for a colour bar.
    """
    toward = np.asarray(view, dtype=np.float64) / np.linalg.norm(view)
    right = np.cross(up, toward)
    right /= np.linalg.norm(right)
    above = np.cross(toward, right)
    axes = np.stack([right, above, toward])
    projected = np.asarray(points, dtype=np.float64) @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    width, height = plotter.renderer.GetSize()
    extent = (high - low)[:2] / (1.0 - margin_right, 1.0)
    scale = 0.5 * 1.06 * max(extent[1], extent[0] * height / width)
    middle = (low + high) / 2.0
    middle[0] += margin_right * scale * width / height
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = middle @ axes
    reach = 2.0 * float(np.linalg.norm(high - low)) + 500.0
    plotter.camera.position = middle @ axes + reach * toward
    plotter.camera.up = above
    plotter.camera.clipping_range = (1.0, 3.0 * reach)
    plotter.camera.parallel_scale = scale
    plotter.add_light(pv.Light(light_type="headlight", intensity=0.7))
    plotter.add_light(pv.Light(position=(-0.6, 1.0, 0.7), light_type="camera light", intensity=0.45))


def in_front(lines: pv.PolyData, view: Sequence[float] | FloatArray, distance: float) -> pv.PolyData:
    """Lines moved towards the camera [mm]: in parallel projection they seem to stay, but no surface hides them."""
    return lines.translate(distance * np.asarray(view) / np.linalg.norm(view))


def shoot(plotter: pv.Plotter, path: Path | str) -> None:
    """Write the picture as ``.png`` and close the plotter."""
    plotter.enable_anti_aliasing("ssaa")
    with atomic_path(path) as temporary:
        plotter.screenshot(temporary)
    plotter.close()
