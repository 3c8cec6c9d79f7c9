"""JointFrame: round trip through JSON, and what is refused."""

import json

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.records.joint_frame import JointFrame, load_joint_frames, save_joint_frames

AXES = rotation_from_vector(np.array([0.3, 0.1, -0.2])).T.tolist()


def test_round_trip(tmp_path) -> None:
    frames = (JointFrame("L2", "L1", (1.0, 2.0, 3.0), AXES, 34.5), JointFrame("L3", "L2", (0.1, 0.2, 0.3), AXES))
    save_joint_frames(frames, tmp_path / "joints.json")
    assert load_joint_frames(tmp_path / "joints.json") == frames
    np.testing.assert_allclose(frames[0].columns[:, 2], AXES[2])


@pytest.mark.parametrize(("first", "axes"), [
    ("L2", -np.array(AXES)), ("L2", np.array(AXES) * 1.01), ("L2", np.eye(2)), ("L1", np.array(AXES)),
])
def test_bad_frames_are_refused(first: str, axes: np.ndarray) -> None:
    with pytest.raises(InputError, match="joint of"):
        JointFrame(first, "L1", (0.0, 0.0, 0.0), axes.tolist())


def test_altered_frames_are_refused(tmp_path) -> None:
    save_joint_frames([JointFrame("L2", "L1", (1.0, 2.0, 3.0), AXES, 34.5)], tmp_path / "joints.json")
    text = (tmp_path / "joints.json").read_text()
    (tmp_path / "joints.json").write_text(text.replace("34.5", "35.5"))
    with pytest.raises(InputError, match="altered after it was made"):
        load_joint_frames(tmp_path / "joints.json")


@pytest.mark.parametrize("text", ["[]", '{"joints": [{"first": "L1"}]}', '{"joints": 3}'])
def test_a_damaged_file_is_refused(tmp_path, text: str) -> None:
    (tmp_path / "joints.json").write_text(json.dumps(json.loads(text)))
    with pytest.raises(InputError, match=r"joints\.json"):
        load_joint_frames(tmp_path / "joints.json")
