"""One flipped bit, wherever it lies in an artefact's files, is noticed when the artefact is read."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from stages.test_seal import READERS, bundle, copied  # noqa: F401 (fixtures)


def is_read(read, folder):
    try:
        read(folder)
    except InputError:
        return False
    return True


@pytest.mark.parametrize("kind", READERS)
def test_any_bit(copied, kind, drill):  # noqa: F811
    folder, read = copied(kind)
    rng = np.random.default_rng(2)
    for name in READERS[kind][1] if drill else READERS[kind][1][:1]:
        path = folder / name
        sound = path.read_bytes()
        for _ in range(100 if drill else 1):
            content = bytearray(sound)
            place, bit = int(rng.integers(len(content))), int(rng.integers(8))
            content[place] ^= 1 << bit
            path.write_bytes(bytes(content))
            assert not is_read(read, folder), f"bit {bit} of byte {place} of {name} was not noticed"
        path.write_bytes(sound)
    assert is_read(read, folder)
