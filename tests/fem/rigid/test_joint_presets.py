"""Presets: published intervals, bending stiffness of the chain, what is refused."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.fem import JointFrame, preset_joints
from mixpinn.fem.rigid.joint_presets import IN_VITRO, PRELOAD_FACTOR, THORACIC, with_figures
from mixpinn.fem.rigid.pelvis_and_ribs import COSTOVERTEBRAL, SACROILIAC
from validation.joints import chain_bending_stiffness, lumbar_frames, measured_stiffness

DEGREE = np.pi / 180.0
# as published: N/mm, then N m/°, each interval typed here a second time
INTERVALS = [(53, 140), (53, 140), (920, 1880), (2.6, 5.5), (6, 11), (7.3, 9.5)]


def test_in_vitro_lies_within_the_published_intervals() -> None:
    """As a testing machine would measure: the caudal part clamped, one load at a time on the cranial one."""
    for joint in preset_joints(lumbar_frames(), "in-vitro"):
        found = measured_stiffness(joint)
        found[3:] *= DEGREE / 1e3
        for value, (low, high), entry in zip(found, INTERVALS, IN_VITRO, strict=True):
            assert low <= value <= high, entry.name


def test_in_vivo_prone_has_the_bending_stiffness_that_was_measured() -> None:
    """38.5 N m² ± 10 %, whatever the spacings; the other stiffnesses are those in vitro times the preload's factor."""
    for spacings in ((36.0, 37.0, 37.0, 36.0), (28.0, 33.0, 41.0, 38.0)):
        joints = preset_joints(lumbar_frames(spacings), "in-vivo-prone")
        assert chain_bending_stiffness(joints) == pytest.approx(38.5e6, rel=0.1)
    loose, tight = (preset_joints(lumbar_frames(), name)[0] for name in ("in-vitro", "in-vivo-prone"))
    ratio = measured_stiffness(tight) / measured_stiffness(loose)
    np.testing.assert_allclose(ratio[[0, 1, 2, 4, 5]], PRELOAD_FACTOR, rtol=1e-4)
    assert ratio[3] > PRELOAD_FACTOR


def test_none_is_no_joints() -> None:
    assert preset_joints(lumbar_frames(), "none") == ()


def test_what_a_preset_cannot_say_is_refused() -> None:
    with pytest.raises(InputError, match="in-vivo-prone"):
        preset_joints(lumbar_frames(), "in-vivo")
    axes = np.eye(3).tolist()
    with pytest.raises(InputError, match="T7 to the sacrum"):
        preset_joints([JointFrame("vertebrae_T5", "vertebrae_T4", (0, 0, 0), axes, 30.0)], "in-vitro")
    with pytest.raises(InputError, match="T7 to the sacrum"):
        preset_joints([JointFrame("vertebrae_L4", "vertebrae_L2", (0, 0, 0), axes, 70.0)], "in-vitro")
    with pytest.raises(InputError, match="spacing"):
        preset_joints([JointFrame("sacrum", "vertebrae_L5", (0, 0, 0), axes)], "in-vivo-prone")
    assert len(preset_joints([JointFrame("sacrum", "vertebrae_L5", (0, 0, 0), axes)], "in-vitro")) == 1


def test_lower_thoracic_segments_have_figures_of_their_own() -> None:
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    thoracic = JointFrame("vertebrae_T12", "vertebrae_T11", (0.0, 0.0, 0.0), axes, 28.0)
    lumbar = JointFrame("vertebrae_L1", "vertebrae_T12", (0.0, 0.0, 28.0), axes, 30.0)
    upper, lower = (np.diag(joint.law.stiffness) for joint in preset_joints([thoracic, lumbar], "in-vitro"))
    for value, entry in zip(upper, THORACIC, strict=True):
        assert entry.low <= value <= entry.high
        assert "abstract" in entry.source
    np.testing.assert_allclose(upper[:3], lower[:3])
    assert (upper[3:] < lower[3:]).all()
    assert with_figures("sacrum", "vertebrae_L5")
    assert not with_figures("vertebrae_L5", "vertebrae_L3")
    assert not with_figures("hip_left", "femur_left")


@pytest.mark.parametrize("preset", ["in-vitro", "in-vivo-prone"])
def test_pelvis_and_ribs_have_figures_within_their_sources(preset) -> None:
    axes = np.eye(3).tolist()
    frames = [JointFrame(first, second, (0, 0, 0), axes) for first, second in (
        ("hip_left", "sacrum"), ("hip_right", "vertebrae_S1"), ("vertebrae_T11", "rib_right_11"),
    )]
    for joint, table in zip(preset_joints(frames, preset), (SACROILIAC, SACROILIAC, COSTOVERTEBRAL), strict=True):
        found = measured_stiffness(joint)
        for value, entry in zip(found, table, strict=True):
            assert entry.low <= entry.value <= entry.high
            assert value == pytest.approx(entry.value, rel=1e-3)
            assert "abstract" in entry.source
    for first, second in (("hip_left", "hip_right"), ("vertebrae_T11", "rib_left_12"), ("rib_left_11", "rib_left_12")):
        assert not with_figures(first, second)
