"""Scratch memory."""

import threading

import numpy as np

from mixpinn.models.scratch import Scratch


def test_a_name_keeps_its_memory_and_grows() -> None:
    scratch = Scratch()
    first = scratch.take("a", (4, 5))
    assert first.shape == (4, 5)
    assert first.dtype == np.float32
    assert np.shares_memory(first, scratch.take("a", (2, 3)))
    assert not np.shares_memory(first, scratch.take("b", (4, 5)))
    assert scratch.take("a", (10, 10)).shape == (10, 10)


def test_threads_do_not_share() -> None:
    scratch = Scratch()
    seen = [scratch.take("a", (3,))]
    thread = threading.Thread(target=lambda: seen.append(scratch.take("a", (3,))))
    thread.start()
    thread.join()
    assert not np.shares_memory(*seen)
