"""Scratch memory."""

import threading

import numpy as np

from mixpinn.networks.scratch import Scratch


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


def test_memory_begins_where_matrix_products_are_reproducible() -> None:
    scratch, kept = Scratch(), []
    for size in range(1, 400, 7):
        kept.append(np.empty(size))  # moves the place where the next small array would begin
        assert scratch.take(str(size), (size,)).ctypes.data % 64 == 0
