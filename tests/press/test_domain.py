"""Poses inside and outside of what was learned."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.validated import checked_record
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.press.domain import PoseDomain
from training.toy_block import block_mesh


def turned(tilt_deg, turn_deg=0.0):
    """Rotation (1, 3, 3) that presses at an angle to −y."""
    angle = np.deg2rad(tilt_deg)
    return probe_rotation(turn_deg, [np.sin(angle), -np.cos(angle), 0.0])[None]


@pytest.fixture(scope="module")
def domain():
    rotations = np.concatenate([turned(0.0, turn) for turn in (0.0, 45.0, 90.0)])
    return PoseDomain.of_samples(
        block_mesh(), rotations, np.array([[15.0, 40.0, 15.0], [20.0, 40.0, 20.0], [25.0, 40.0, 25.0]]),
        np.array([5.0, 12.0, 20.0]),
    )


def test_what_was_learned_is_inside_whatever_the_turn(domain) -> None:
    for tilt, turn in ((0.0, 0.0), (14.9, 200.0), (15.0, 77.0)):
        assert domain.reasons(turned(tilt, turn), np.array([[20.0, 35.0, 20.0]]), np.array([19.0])) == ()


@pytest.mark.parametrize(("tilt", "place", "depth", "word"), [
    (0.0, (20.0, 30.0, 20.0), 21.0, "first touch"), (25.0, (20.0, 30.0, 20.0), 5.0, "tilted"),
    (0.0, (200.0, 30.0, 20.0), 5.0, "beside"), (0.0, (20.0, 90.0, 20.0), -50.0, "far from the skin"),
    (0.0, (20.0, 90.0, 20.0), -np.inf, "far from the skin"),
])
def test_each_way_outside_has_its_reason(domain, tilt, place, depth, word) -> None:
    reasons = domain.reasons(turned(tilt), np.array([place]), np.array([depth]))
    assert len(reasons) == 1
    assert word in reasons[0]


@pytest.mark.parametrize(("tilt", "depth"), [(180.0, 5.0), (90.0, 5.0), (0.0, 60.0), (0.0, 100.0)])
def test_what_makes_no_sense_is_refused(domain, tilt, depth) -> None:
    with pytest.raises(InputError, match="pose"):
        domain.refuse_nonsense(turned(tilt), np.array([depth]))


def test_tips_outside_of_all_learned_from_are_told_apart_steadily(domain) -> None:
    def beyond(*place):
        return domain.beyond(np.array([place]))

    assert beyond(20.0, 30.0, 20.0) == beyond(25.0, 0.0, 15.0) == 0.0
    assert beyond(28.0, 30.0, 20.0) == pytest.approx(3.0)
    assert beyond(28.0, 30.0, 11.0) == pytest.approx(5.0)
    assert domain.beyond(np.array([[20.0, 30.0, 20.0], [25.0, 30.0, 27.0]])) == pytest.approx(2.0)
    assert PoseDomain.of_mesh(block_mesh()).beyond(np.array([[500.0, 0.0, 0.0]])) == 0.0  # nothing was learned from


def test_plain_values_keep_a_domain(domain) -> None:
    assert checked_record(PoseDomain, domain.as_dict(), "pose model", remake="fit it again") == domain
