"""The spread of the expected error keeps its mean, and is unknown where the bundle knows none."""

from dataclasses import replace

import numpy as np
import pytest

from mixpinn.records.answer import Trust
from mixpinn.serving.live.error_field import error_field
from serving.live.pressed import above


def test_the_mean_is_the_expected_error(pressing) -> None:
    answer = pressing.press(above().translation)
    assert error_field(answer) is None
    spread = error_field(replace(answer, trust=Trust(expected=0.04, bound=0.1, level=0.95)))
    assert spread.mean() == pytest.approx(0.04)
    assert np.argmax(spread) == np.argmax(np.linalg.norm(answer.displacement, axis=1))
    still = replace(answer, displacement=0.0 * answer.displacement, trust=Trust(expected=0.0))
    assert not error_field(still).any()
