"""From a place on the skin to a pose: the axis goes through the place, and the depth is that beyond first touch."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.serving.live import SkinPlacement
from serving.live.pressed import UP

POINT = np.array([18.0, UP, 22.0])


@pytest.fixture(scope="module")
def skin(pressing):
    return SkinPlacement(pressing.pose)


@pytest.mark.parametrize("depth", [-3.0, 0.0, 5.0])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (8.0, -5.0)])
def test_the_axis_goes_through_the_place_and_the_depth_is_kept(skin, pressing, depth, tilt) -> None:
    pose = skin.place(POINT, depth=depth, turn_deg=30.0, tilt_deg=tilt)
    way = pose.translation - POINT
    assert_allclose(np.cross(way, pose.axis), 0.0, atol=1e-9)
    probe = pressing.pose.probes[0]
    beyond = pressing.pose.contact.depth([probe], pose.rotation[None], pose.translation[None])
    assert_allclose(beyond, depth, atol=1e-9)


def test_where_on_the_axis_the_pointer_hit_does_not_matter(skin) -> None:
    deformed = POINT - [0.0, 3.0, 0.0]
    assert_allclose(
        skin.place(POINT, depth=4.0).translation, skin.place(deformed, depth=4.0).translation, atol=1e-9,
    )


def test_the_normal_of_a_flat_top_points_up(skin) -> None:
    assert_allclose(skin.normal(POINT), [0.0, 1.0, 0.0], atol=1e-9)
    pose = skin.place(POINT, depth=2.0, axis="normal", turn_deg=90.0)
    assert_allclose(pose.axis, [0.0, -1.0, 0.0], atol=1e-9)
    assert_allclose(pose.rotation @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=1e-9)


def test_tilts_turn_about_the_worlds_axes(skin) -> None:
    about_x = skin.rotation(POINT, tilt_deg=(10.0, 0.0)) @ PROBE_AXIS
    assert_allclose(about_x, [0.0, -np.cos(np.deg2rad(10.0)), -np.sin(np.deg2rad(10.0))], atol=1e-12)
    about_z = skin.rotation(POINT, tilt_deg=(0.0, 10.0)) @ PROBE_AXIS
    assert_allclose(about_z, [np.sin(np.deg2rad(10.0)), -np.cos(np.deg2rad(10.0)), 0.0], atol=1e-12)


def test_beside_the_skin_and_nonsense_are_refused(skin) -> None:
    with pytest.raises(InputError, match="point at the back"):
        skin.place([500.0, UP, 0.0], depth=2.0)
    with pytest.raises(InputError, match="finite"):
        skin.place(POINT, depth=np.nan)
