"""Flips of single bits in an artefact's files: refused in one line, or the same answer as without it."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base import manifest
from mixpinn.base.errors import InputError

MANY, FEW = 200, 2
"""Flips of a file, in `make drill` and otherwise."""


@dataclass(frozen=True)
class Artefact:
    """A folder, what is read from it, and the kinds of its files: of each a pattern, the first match is damaged."""

    folder: Path
    answer: Callable[[Path], object]
    files: tuple[str, ...]


def said(work: Callable[[Path], object], folder: Path) -> object:
    """The answer, or None where one line refuses it; anything else is raised."""
    manifest._checked.clear()  # flips follow each other faster than the clock of the file system ticks
    try:
        return work(folder)
    except InputError as error:
        line = str(error)
    assert "\n" not in line
    assert len(line) < 600
    return None


def flip_each(copy: Artefact, *, many: int) -> dict[str, int]:
    """Flip `many` random bits of each file, one at a time; how many were refused. Others change no answer.

    Args:
        copy: of an artefact, beside which a pristine one is kept.
        many: flips of a file.
    """
    sound = said(copy.answer, copy.folder)
    assert sound is not None
    rng = np.random.default_rng(2)
    pristine = copy.folder.with_name("pristine")
    shutil.copytree(copy.folder, pristine)
    refused = {}
    for pattern in copy.files:
        path = sorted(copy.folder.glob(pattern))[0]
        content = path.read_bytes()
        refused[pattern] = 0
        for _ in range(many):
            flipped = bytearray(content)
            place, bit = int(rng.integers(len(content))), int(rng.integers(8))
            flipped[place] ^= 1 << bit
            path.write_bytes(bytes(flipped))
            answer = said(copy.answer, copy.folder)
            assert answer is None or answer == sound, f"bit {bit} of byte {place} of {pattern}: {answer}"
            refused[pattern] += answer is None
            if path.read_bytes() != bytes(flipped):  # the answer was made anew
                shutil.rmtree(copy.folder)
                shutil.copytree(pristine, copy.folder)
            path.write_bytes(content)
    assert said(copy.answer, copy.folder) == sound
    return refused
