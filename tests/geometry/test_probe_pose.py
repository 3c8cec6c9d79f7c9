"""Poses of the probe: its axis, the way between two poses, turns about the pressing direction."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mixpinn.geometry.probe_pose import PROBE_AXIS, ProbePose, probe_rotation
from mixpinn.geometry.rotations import rotation_about_y


def test_turns_about_y_are_those_of_scipy():
    angles = np.array([-30.0, 0.0, 45.0, 200.0])
    expected = Rotation.from_euler("y", angles[:, None], degrees=True).as_matrix()
    np.testing.assert_allclose(rotation_about_y(angles), expected, atol=1e-14)


@pytest.mark.parametrize("direction", [(0.0, -1.0, 0.0), (0.3, -2.0, 0.5), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_a_turned_probe_presses_along_the_direction_and_turns_about_it(direction):
    unit = np.array(direction) / np.linalg.norm(direction)
    plain, turned = probe_rotation([0.0, 70.0], direction)
    np.testing.assert_allclose(ProbePose(turned, np.zeros(3)).axis, unit, atol=1e-12)
    between = Rotation.from_matrix(turned @ plain.T).as_rotvec(degrees=True)
    np.testing.assert_allclose(between, -70.0 * unit, atol=1e-9)  # about +y where the probe presses along -y


def test_halfway_between_two_poses():
    start = ProbePose(np.eye(3), np.zeros(3))
    end = ProbePose(rotation_about_y(90.0), np.array([2.0, 4.0, 6.0]))
    middle = start.towards(end, 0.5)
    np.testing.assert_allclose(middle.rotation, rotation_about_y(45.0), atol=1e-12)
    np.testing.assert_allclose(middle.place(PROBE_AXIS[None]), [[1.0, 1.0, 3.0]], atol=1e-12)
