from itertools import pairwise

import pytest

from mixpinn.pipeline.onboarding import round_ends


@pytest.mark.parametrize("poses", [1, 3, 8, 9, 16, 24, 40, 132])
def test_rounds_end_with_all_poses_and_the_last_is_no_larger_than_the_first(poses) -> None:
    ends = round_ends(poses, 8)
    assert ends == sorted(set(ends))
    assert ends[-1] == poses
    assert ends[0] == min(poses, 8)
    assert all(after <= 2 * before for before, after in pairwise(ends))
    if len(ends) > 1:
        assert ends[-1] - ends[-2] <= 8
