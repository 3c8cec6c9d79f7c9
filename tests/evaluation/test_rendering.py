"""Pictures are written, are not blank, and show both meshes; without OpenGL there is a note instead."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from matplotlib.image import imread

from mixpinn.evaluation import Case, Picture, RenderingUnavailable, render_error_map, render_pictures
from mixpinn.evaluation import rendering as rendering_module
from mixpinn.evaluation.rendering import _round_limit
from mixpinn.records import Probe, TissueMesh


@pytest.fixture(scope="module")
def case() -> Case:
    """A block of 120 × 80 × 120 mm with a rigid inner node, dented in the middle of its back."""
    block = pv.ImageData(dimensions=(7, 5, 7), spacing=(20, 20, 20), origin=(-60, -40, -60)).to_tetrahedra(5)
    points = np.asarray(block.points, dtype=np.float64)
    cells = block.cells_dict[pv.CellType.TETRA].astype(np.int32)
    inner = np.abs(points).max(axis=1) < 25.0
    # The rigid part is a cavity: the cells inside it are taken out.
    cells = cells[~inner[cells].all(axis=1)]
    mesh = TissueMesh(
        points, cells, inner.astype(np.int16), points[:, 1] < -39.0, ("vertebrae_L3",),
        np.zeros(len(cells), dtype=np.int16),
    )
    dent = 12.0 * np.exp(-np.square(points[:, [0, 2]]).sum(axis=1) / 600.0) * (points[:, 1] + 40.0) / 80.0
    reference = np.column_stack([np.zeros_like(dent), -dent, np.zeros_like(dent)])
    surface = pv.Box((-20, 20, 0, 40, -6, 6)).triangulate()
    probe = Probe(np.asarray(surface.points, dtype=np.float64), surface.regular_faces.astype(np.int64))
    return Case(mesh, reference, 0.8 * reference, "toy", np.array([0.0, 28.0, 0.0]), 12.0, probe, np.eye(3))


@pytest.fixture(scope="module")
def pictures(case: Case, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Picture]:
    """The case's pictures by file name; skips where nothing can be drawn."""
    drawn, note = render_pictures(case, tmp_path_factory.mktemp("pictures"))
    if note:
        pytest.skip(note)
    return {picture.path.name: picture for picture in drawn}


def pixels(path: Path) -> np.ndarray:
    return (imread(path)[..., :3] * 255).astype(int)


def test_all_pictures_are_drawn(pictures: dict[str, Picture]) -> None:
    assert list(pictures) == ["prediction.png", "cut.png", "error.png"]
    assert all(picture.caption for picture in pictures.values())


def test_comparison_shows_red_lines_over_grey(pictures: dict[str, Picture]) -> None:
    picture = pictures["prediction.png"]
    image = pixels(picture.path)
    red = (image[..., 0] > 150) & (image[..., 1] < 90) & (image[..., 2] < 90)
    grey = (np.ptp(image, axis=2) < 16) & (image.max(axis=2) < 230)
    assert red.mean() > 0.002
    assert grey.mean() > 0.1
    assert "toy at 12 mm" in picture.caption


def test_cut_shows_the_rigid_part_in_its_colour(pictures: dict[str, Picture]) -> None:
    image = pixels(pictures["cut.png"].path)
    blue = (image[..., 2] > image[..., 0] + 50) & (image[..., 2] > 90)
    assert blue.mean() > 0.01
    assert (image.min(axis=2) < 250).mean() > 0.3


def test_error_map_is_pale_where_there_is_no_error(
    case: Case, pictures: dict[str, Picture], tmp_path: Path,
) -> None:
    exact = dataclasses.replace(case, predicted=case.reference, probe=None)
    strong = []
    for path in (pictures["error.png"].path, render_error_map(exact, tmp_path / "exact.png").path):
        image = pixels(path)
        back = image[:, : image.shape[1] // 2]  # the other half has the colour bar
        assert (back.min(axis=2) < 250).mean() > 0.2
        strong.append(((back[..., 0] > 100) & (back[..., 1] < 90)).mean())
    assert strong[0] > 0.005
    assert strong[1] == 0.0


def test_without_opengl_there_is_a_note(case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unavailable() -> None:
        raise RenderingUnavailable("no OpenGL")

    monkeypatch.setattr(rendering_module, "start_rendering", unavailable)
    assert render_pictures(case, tmp_path) == ((), "no OpenGL")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("value", "limit"), [(1.02, 1.2), (0.39, 0.4), (4.0, 4.0), (0.0101, 0.012), (33.0, 40.0)])
def test_colour_limits_have_round_quarters(value: float, limit: float) -> None:
    assert _round_limit(value) == pytest.approx(limit)
