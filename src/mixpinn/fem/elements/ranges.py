"""Run a compiled kernel over a range of entries, in one thread or several."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

_SMALLEST = 2000
"""Entries below which a thread costs more than it saves."""


class RangeRunner:
    """Calls ``kernel(start, stop, *arguments)`` so that the ranges cover 0 … count.

    The kernels release the GIL and write only their own entries, hence results do not depend on `threads`.
    """

    def __init__(self, threads: int = 1) -> None:
        self.threads = max(1, threads)
        self._pool: ThreadPoolExecutor | None = None

    def __call__(self, kernel: Callable[..., None], count: int, *arguments: Any) -> None:
        if self.threads == 1 or count < _SMALLEST:
            kernel(0, count, *arguments)
            return
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads)
        bounds = np.linspace(0, count, self.threads + 1).astype(np.int64).tolist()
        jobs = [self._pool.submit(kernel, start, stop, *arguments) for start, stop in pairwise(bounds)]
        for job in jobs:
            job.result()
