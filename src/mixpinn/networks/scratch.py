"""Scratch memory that is kept between calls, since fresh pages cost as much as the arithmetic on them."""

import math
import threading

import torch

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
            # torch's memory begins at a multiple of 64 bytes. Matrix products may differ in their last digits with
            # the alignment of their factors, which NumPy leaves to chance.
            buffer = self._buffers[name] = torch.empty(size, dtype=torch.float32).numpy()
        return buffer[:size].reshape(shape)


scratch = Scratch()
