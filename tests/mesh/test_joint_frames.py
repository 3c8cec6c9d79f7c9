"""Joint frames of blocky vertebrae whose place and tilt are known, and of the paper's mesh."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.mesh import draw_joint_frames, joint_frames, load_paper_mesh
from mixpinn.mesh.joint_frames import BoneSurface, neighbours
from mixpinn.records import TissueMesh
from validation.kuhn import grid_points, kuhn_cells

BODY, DISC, WIDTH, DEPTH = 24.0, 12.0, 36.0, 30.0


def inside(points: np.ndarray, low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    return ((points >= np.array(low) - 1e-9) & (points <= np.array(high) + 1e-9)).all(axis=1)


def vertebra(points: np.ndarray) -> np.ndarray:
    """Body, two pedicles beside the canal, lamina and spinous process; the body's front at y = 0, its top at z = 0."""
    return (
        inside(points, (-18, 0, 0), (18, DEPTH, BODY)) | inside(points, (-18, DEPTH, 0), (-12, 48, 12))
        | inside(points, (12, DEPTH, 0), (18, 48, 12)) | inside(points, (-18, 42, 0), (18, 48, 12))
        | inside(points, (-6, 48, 0), (6, 72, 12))
    )


def spine(count: int = 2, names: tuple[str, ...] = ("vertebrae_L4", "vertebrae_L5", "sacrum")) -> TissueMesh:
    """Straight spine of blocky vertebrae as cavities of a block, on a grid of 6 mm."""
    height = count * (BODY + DISC) - DISC
    axes = [np.arange(-30.0, 30.1, 6.0), np.arange(-12.0, 84.1, 6.0), np.arange(-12.0, height + 12.1, 6.0)]
    points, cells = grid_points(*axes), kuhn_cells(tuple(len(axis) - 1 for axis in axes))
    part = np.zeros(len(points), dtype=np.int16)
    for k in range(count):
        part[vertebra(points - [0.0, 0.0, k * (BODY + DISC)])] = k + 1
    group = part[cells]
    cells = cells[(group == 0).any(axis=1) | (group != group[:, :1]).any(axis=1)]
    used, index = np.unique(cells, return_inverse=True)
    return TissueMesh(
        points[used], index.reshape(cells.shape).astype(np.int32), part[used], np.zeros(len(used), bool), names[:count],
        np.zeros(len(cells), np.int16),
    )


@pytest.fixture(scope="module")
def straight() -> TissueMesh:
    return spine()


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.25, 0.0, 0.0), (-0.3, 0.1, 0.1)])
def test_origin_between_the_end_plates_and_axes_of_the_bodies(straight: TissueMesh, turn: tuple[float, ...]) -> None:
    """Wherever the spine lies and however it is tilted: the origin in the middle of the disc, the bones' own axes."""
    rotation, shift = rotation_from_vector(np.array(turn)), np.array([20.0, -30.0, 5.0])
    mesh = TissueMesh(
        straight.points @ rotation.T + shift, straight.cells, straight.part, straight.fixed, straight.rigid_names,
        straight.tissue,
    )
    (frame,) = joint_frames(mesh)
    assert (frame.first, frame.second) == ("vertebrae_L5", "vertebrae_L4")
    place = rotation.T @ (frame.centre - shift)
    np.testing.assert_allclose(place, [0.0, 0.5 * DEPTH, BODY + 0.5 * DISC], atol=1.0)
    np.testing.assert_allclose(rotation.T @ frame.columns, np.eye(3), atol=0.03)
    np.testing.assert_allclose(rotation.T @ frame.columns[:, 2], [0.0, 0.0, 1.0], atol=1e-3)
    assert frame.spacing == pytest.approx(BODY + DISC, abs=1.0)


def test_neighbours_along_the_spine_and_the_sacrum() -> None:
    """Three bones make two joints, from head to foot; the sacrum's half of the spacing is the other body's."""
    frames = joint_frames(spine(3))
    assert [frame.name for frame in frames] == ["vertebrae_L4-vertebrae_L5", "vertebrae_L5-sacrum"]
    np.testing.assert_allclose([frame.spacing for frame in frames], BODY + DISC, atol=1.0)


def test_what_has_no_end_plates_is_refused(straight: TissueMesh) -> None:
    with pytest.raises(InputError, match="rigid parts of the mesh"):
        joint_frames(straight, between=[("sacrum", "vertebrae_L5")])
    bones = TissueMesh(
        straight.points, straight.cells, straight.part, straight.fixed, ("left", "right"), straight.tissue,
    )
    assert joint_frames(bones) == ()


def test_picture(straight: TissueMesh, tmp_path) -> None:
    draw_joint_frames(straight, joint_frames(straight), tmp_path / "joints.png")
    assert (tmp_path / "joints.png").stat().st_size > 5000


def test_the_papers_mesh(shared_data) -> None:
    """Four joints in a row, 30 to 45 mm apart, axes near the world's, the lordosis turning them one way."""
    frames = joint_frames(load_paper_mesh(shared_data / "patient1" / "paper"))
    assert len(frames) == 4
    places, axes = np.array([frame.centre for frame in frames]), np.array([frame.axes for frame in frames])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert ((steps > 30.0) & (steps < 45.0)).all()
    assert all(30.0 < frame.spacing < 45.0 for frame in frames)
    assert (np.einsum("jii->ji", axes) > 0.95).all()
    assert (np.diff(axes[:, 2, 1]) > 0.0).all()


def test_a_hip_is_joined_to_the_middle_of_the_sacrum_with_the_axes_of_its_end_plate() -> None:
    mesh = spine(3, ("vertebrae_L5", "sacrum", "hip_left"))
    assert neighbours(mesh) == (("sacrum", "vertebrae_L5"), ("hip_left", "sacrum"))
    frame = joint_frames(mesh)[1]
    sacrum = vertebra_middle(mesh, "sacrum")
    np.testing.assert_allclose(frame.centre, sacrum, atol=1e-9)
    np.testing.assert_allclose(frame.axes, np.eye(3), atol=1e-9)


def test_a_rib_is_joined_to_the_vertebra_of_its_number_where_the_two_are_nearest() -> None:
    mesh = spine(2, ("vertebrae_T12", "rib_left_12"))
    assert neighbours(mesh) == (("vertebrae_T12", "rib_left_12"),)
    (frame,) = joint_frames(mesh)
    assert frame.origin[2] == pytest.approx(BODY + 0.5 * DISC)
    np.testing.assert_allclose(frame.axes, np.eye(3))
    assert neighbours(spine(2, ("vertebrae_T12", "rib_left_11"))) == ()
    far = spine(3, ("vertebrae_T12", "femur_left", "rib_left_12"))
    with pytest.raises(InputError, match="25 mm from its vertebra"):
        joint_frames(far, between=[("vertebrae_T12", "rib_left_12")])


def vertebra_middle(mesh: TissueMesh, name: str) -> np.ndarray:
    return BoneSurface.of_part(mesh, mesh.rigid_names.index(name) + 1).middle
