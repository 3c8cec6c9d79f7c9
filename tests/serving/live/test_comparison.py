"""The full solution of one probe and of several that are solved as one."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.serving.live.comparison import Setup, solve_fully
from serving.live.pressed import above, block_predictor


@pytest.fixture(scope="module")
def predictor():
    return block_predictor()


def test_a_probe_in_the_air_beside_it_changes_nothing(predictor) -> None:
    pressed, lifted = above(x=14.0, z=14.0, depth=1.5), above(x=34.0, z=34.0, depth=-15.0)
    alone = solve_fully(Setup.of_predictor(predictor, [pressed]))
    both = solve_fully(Setup.of_predictor(predictor, [pressed, lifted]))
    assert_allclose(both.displacement, alone.displacement, atol=1e-5)
    assert_allclose(both.force, [alone.force, np.zeros(3)], atol=1e-5)
    assert_allclose(both.moment[0], alone.moment, atol=1e-4)
    assert np.linalg.norm(alone.force) > 0.1


def test_forces_of_two_probes_do_not_depend_on_which_comes_first(predictor) -> None:
    poses = [above(x=10.0, z=10.0, depth=1.5), above(x=32.0, z=32.0, depth=1.0)]
    found, turned = (solve_fully(Setup.of_predictor(predictor, some)) for some in (poses, poses[::-1]))
    assert_allclose(found.displacement, turned.displacement, atol=2e-3)
    assert_allclose(found.force, turned.force[::-1], atol=5e-3)
    assert (found.force[:, 1] > 0.05).all()


def test_probes_that_press_in_different_directions_are_refused(predictor) -> None:
    tilted = ProbePose(rotation_from_vector(np.array([0.1, 0.0, 0.0])), np.array([30.0, 41.0, 30.0]))
    with pytest.raises(InputError, match="same direction"):
        Setup.of_predictor(predictor, [above(), tilted])
