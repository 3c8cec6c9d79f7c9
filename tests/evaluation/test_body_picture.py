"""The picture of a body: sections cover what they cut, and joints, supports and held parts are drawn."""

from dataclasses import replace

import numpy as np
import pytest

from fem.block_mesh import block, two_bones
from mixpinn.evaluation.body_picture import cut_cells, cut_surface, draw_body
from mixpinn.fem import Joint, JointFrame, LinearBushing
from mixpinn.physics.restraints import Restraints
from mixpinn.stages.restraints import TABLE


def area(polygon: np.ndarray, axis: int) -> float:
    x, y = np.delete(polygon, axis, axis=1).T
    return 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_polygons_fill_the_section(axis) -> None:
    mesh = block((3, 4, 5), size=(30.0, 40.0, 50.0), shake=0.2)
    polygons, cells = cut_cells(mesh.points, mesh.cells, axis=axis, place=17.0)
    whole = 60000.0 / (30.0, 40.0, 50.0)[axis]
    assert sum(area(polygon, axis) for polygon in polygons) == pytest.approx(whole)
    assert len(cells) == len(polygons)
    assert {len(polygon) for polygon in polygons} <= {3, 4}


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_outlines_enclose_the_section_of_a_closed_surface(axis) -> None:
    mesh = block((3, 4, 5), size=(30.0, 40.0, 50.0), shake=0.2)
    loops = cut_surface(mesh.points, mesh.boundary_faces, axis=axis, place=17.0)
    assert len(loops) == 1
    assert area(loops[0], axis) == pytest.approx(60000.0 / (30.0, 40.0, 50.0)[axis])


def test_two_surfaces_have_two_outlines() -> None:
    mesh = block((3, 4, 5), size=(30.0, 40.0, 50.0), shake=0.2)
    points = np.concatenate([mesh.points, np.add(mesh.points, (100.0, 0.0, 0.0))])
    faces = np.concatenate([mesh.boundary_faces, mesh.boundary_faces + mesh.n_points])
    loops = cut_surface(points, faces, axis=2, place=17.0)
    assert [area(loop, 2) for loop in loops] == pytest.approx([1200.0, 1200.0])


def test_a_picture_is_written(tmp_path) -> None:
    mesh = two_bones()
    mesh = replace(mesh, fixed=mesh.fixed | (mesh.part == 2))
    frame = JointFrame("bone1", "bone2", (30.0, 15.0, 16.0), ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    tied = Restraints((Joint(frame, LinearBushing.of_diagonal([1.0] * 6)),), (TABLE,))
    draw_body(mesh, tied, tmp_path / "body.png")
    assert (tmp_path / "body.png").stat().st_size > 10_000
