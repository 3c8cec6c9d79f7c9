"""The camera frames exactly what it is told to show."""

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from matplotlib.image import imread

from mixpinn.evaluation import RenderingUnavailable
from mixpinn.evaluation.rendering_camera import aim, in_front, new_plotter, shoot


def shot(path: Path, view: tuple[float, float, float], margin_right: float = 0.0) -> np.ndarray:
    """Mask of the pixels that a box of 40 × 20 × 10 mm covers."""
    try:
        plotter = new_plotter((400, 300))
    except RenderingUnavailable as error:
        pytest.skip(str(error))
    box = pv.Box((100, 140, 0, 20, 0, 10))
    plotter.add_mesh(box, color="black")
    aim(plotter, box.points, view, margin_right=margin_right)
    shoot(plotter, path)
    return imread(path)[..., :3].min(axis=2) < 0.5


def test_box_fills_the_picture(tmp_path: Path) -> None:
    rows, columns = np.nonzero(shot(tmp_path / "box.png", (0.0, 0.0, 1.0)))
    # 40 mm across 400 pixels with a margin of 6 %: 377 pixels wide and half as high, in the middle.
    assert np.ptp(columns) == pytest.approx(377, abs=3)
    assert np.ptp(rows) == pytest.approx(189, abs=3)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(200, abs=2)


def test_margin_on_the_right_stays_free(tmp_path: Path) -> None:
    mask = shot(tmp_path / "box.png", (0.0, 0.0, 1.0), margin_right=0.2)
    assert not mask[:, 325:].any()
    assert mask[:, :20].any()


def test_lines_in_front_do_not_move_on_screen() -> None:
    line = pv.Line((0, 0, 0), (1, 2, 3))
    view = np.array([1.0, 2.0, 2.0])
    moved = in_front(line, view, 6.0)
    assert moved.points - line.points == pytest.approx(np.tile([2.0, 4.0, 4.0], (2, 1)), abs=1e-5)
