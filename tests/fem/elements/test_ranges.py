import numpy as np
import pytest

from mixpinn.fem.elements.ranges import RangeRunner


@pytest.mark.parametrize("threads", [0, 1, 2, 3])
@pytest.mark.parametrize("count", [0, 5, 10_001])
def test_every_entry_is_visited_once(threads, count):
    visits = np.zeros(count, dtype=int)

    def visit(start, stop, step):
        visits[start:stop] += step

    RangeRunner(threads)(visit, count, 2)
    assert (visits == 2).all()
    assert visits.sum() == 2 * count


def test_errors_in_a_thread_are_not_lost():
    def fail(start, stop):
        raise ValueError("in the range")

    with pytest.raises(ValueError, match="in the range"):
        RangeRunner(2)(fail, 10_000)
