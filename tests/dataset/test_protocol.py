import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.dataset import PAPER, SOFA_REPLAY, Pose, Protocol, list_poses, probe_path, read_positions
from mixpinn.geometry.probe_pose import probe_rotation

ANGLES = st.floats(-360.0, 360.0)
DIRECTIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1)


def test_paper_path_starts_above_and_ends_twenty_below():
    path = probe_path((5.0, 134.0, -3.0), 0.0, PAPER)
    assert len(path) == 28
    assert path.depths[0] == -7.0
    assert path.depths[8:].tolist() == list(range(1, 21))
    np.testing.assert_allclose(path.translations[:, 1], 134.0 - path.depths)
    np.testing.assert_allclose(path.translations[:, [0, 2]], np.tile([5.0, -3.0], (28, 1)))


def test_replay_is_where_the_recordings_say_the_collision_mesh_was(shared_data):
    positions = read_positions(shared_data / "patient1/paper/probe_positions.txt")
    for name in ("pose_000_000", "pose_035_090"):
        with np.load(shared_data / f"sofa/{name}.npz") as recording:
            index, rotation = int(recording["position_index"]), float(recording["rotation_deg"])
            path = probe_path(positions[index], rotation, SOFA_REPLAY)
            np.testing.assert_allclose(path.translations, recording["contact_probe_position"], atol=1e-4)


@given(angle=ANGLES, direction=DIRECTIONS)
@example(angle=0.0, direction=(1e-5, 1.0, 0.0))
@example(angle=10.0, direction=(0.1425, 1.0, 0.0))
def test_probe_rotation_is_a_rotation_that_points_along_the_direction(angle, direction):
    rotation = probe_rotation(angle, direction)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) > 0.0
    np.testing.assert_allclose(rotation @ [0.0, -1.0, 0.0], np.array(direction) / np.linalg.norm(direction), atol=1e-9)


def test_probe_rotation_about_the_pressing_axis():
    quarter = probe_rotation(90.0)
    np.testing.assert_allclose(quarter @ [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(probe_rotation(0.0, (0.0, 1.0, 0.0)) @ [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


def test_path_follows_any_direction():
    protocol = Protocol(direction=(2.0, 0.0, 0.0), approach=1.0, step=0.5, steps=4)
    path = probe_path((0.0, 0.0, 0.0), 30.0, protocol)
    np.testing.assert_allclose(path.translations, [[-0.5, 0, 0], [0, 0, 0], [0.5, 0, 0], [1, 0, 0]], atol=1e-12)


def test_poses_keep_rotations_of_a_position_together():
    poses = list_poses(np.zeros((132, 3)), PAPER)
    assert len(poses) == 528
    assert [pose.name for pose in poses[:5]] == [
        "pose_000_000", "pose_000_045", "pose_000_090", "pose_000_135", "pose_001_000",
    ]
    assert Pose(7, (0.0, 0.0, 0.0), -22.5).name == "pose_007_337.500"


@pytest.mark.parametrize("wrong", [
    {"rotations": ()}, {"rotations": (0.0, 0.0)}, {"step": 0.0}, {"steps": 0}, {"direction": (0.0, 0.0, 0.0)},
    {"spacing": -1.0}, {"max_positions": 0},
])
def test_impossible_protocols_are_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        Protocol(**wrong)


def test_protocol_is_a_configuration():
    assert build_config(Protocol, {"rotations": [0, 45], "steps": 3}).rotations == (0.0, 45.0)


@pytest.mark.parametrize("text", ["", "1 2\n", "1 2 x\n", "1 2 nan\n", "1 2 3\n4 5\n"])
def test_unusable_position_files_are_refused(tmp_path, text):
    (tmp_path / "positions.txt").write_text(text)
    with pytest.raises(InputError, match=r"positions\.txt"):
        read_positions(tmp_path / "positions.txt")


def test_positions_are_read_with_blanks_or_commas(tmp_path):
    (tmp_path / "a.txt").write_text("# tip\n1 2 3\n4 5 6\n")
    (tmp_path / "b.csv").write_text("1,2,3\n4,5,6\n")
    for name in ("a.txt", "b.csv"):
        np.testing.assert_array_equal(read_positions(tmp_path / name), [[1, 2, 3], [4, 5, 6]])
    with pytest.raises(InputError, match="no such file"):
        read_positions(tmp_path / "c.txt")
