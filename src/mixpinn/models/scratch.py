"""Scratch memory that is kept between calls, since fresh pages cost as much as the arithmetic on them."""

import math
import threading

import numpy as np

from mixpinn.base.arrays import Float32Array


class Scratch(threading.local):
    """Named float32 buffers of the calling thread; the content lasts until the name is taken again."""

    def __init__(self) -> None:
        self._buffers: dict[str, Float32Array] = {}

    def take(self, name: str, shape: tuple[int, ...]) -> Float32Array:
        """An uninitialised array of `shape` in the buffer `name`, which grows as needed."""
        size = math.prod(shape)
        buffer = self._buffers.get(name)
        if buffer is None or len(buffer) < size:
            buffer = self._buffers[name] = np.empty(size, np.float32)
        return buffer[:size].reshape(shape)


scratch = Scratch()
