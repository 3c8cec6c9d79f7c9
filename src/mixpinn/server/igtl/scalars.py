"""How the protocol numbers the types of array elements, in IMAGE and NDARRAY alike."""

from typing import Any

import numpy as np

SCALARS: dict[int, np.dtype[Any]] = {
    2: np.dtype("i1"), 3: np.dtype("u1"), 4: np.dtype("i2"), 5: np.dtype("u2"), 6: np.dtype("i4"), 7: np.dtype("u4"),
    10: np.dtype("f4"), 11: np.dtype("f8"),
}
"""Element type by its number, in the machine's byte order."""


def scalar_code(dtype: np.dtype[Any]) -> int:
    """The number of an element type.

    Raises:
        ValueError: a type that the protocol lacks.
    """
    native = dtype.newbyteorder("=")
    for code, known in SCALARS.items():
        if known == native:
            return code
    raise ValueError(f"the protocol has no {dtype}; convert the array")
