import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mixpinn.dataset import Protocol, farthest_first, list_poses


def grid(n):
    x, z = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    return 10.0 * np.stack([x.ravel(), np.zeros(n * n), z.ravel()], axis=1)


@given(st.integers(1, 6), st.sampled_from([(0.0,), (0.0, 90.0), (0.0, 45.0, 90.0, 135.0)]))
def test_every_pose_once(n, rotations):
    poses = list_poses(grid(n), Protocol(rotations=rotations))
    assert sorted(farthest_first(poses), key=poses.index) == list(poses)


def test_corners_of_a_square_follow_its_middle():
    ordered = farthest_first(list_poses(grid(5), Protocol(rotations=(0.0,))))
    assert ordered[0].position == (20.0, 0.0, 20.0)
    assert {pose.position[::2] for pose in ordered[1:5]} == {(0.0, 0.0), (0.0, 40.0), (40.0, 0.0), (40.0, 40.0)}


def test_a_half_turn_is_no_distance():
    ordered = farthest_first(list_poses(np.zeros((1, 3)), Protocol(rotations=(0.0, 180.0, 90.0))))
    assert [pose.rotation_deg for pose in ordered] == [0.0, 90.0, 180.0]


def test_no_poses():
    assert farthest_first([]) == ()
