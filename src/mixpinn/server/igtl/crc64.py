"""The protocol's checksum: CRC-64 of ECMA-182, most significant bit first, started at zero, not inverted."""

import numba
import numpy as np

from mixpinn.base.arrays import AnyArray

_POLYNOMIAL = 0x42F0E1EBA9EA3693
_MASK = (1 << 64) - 1


def _tables() -> AnyArray:
    """What each byte adds to the checksum when 0 … 7 bytes follow it, uint64, shape (8, 256)."""
    first = []
    for byte in range(256):
        value = byte << 56
        for _ in range(8):
            value = (value << 1) & _MASK ^ (_POLYNOMIAL if value >> 63 else 0)
        first.append(value)
    tables = [first]
    for _ in range(7):
        tables.append([(value << 8) & _MASK ^ first[value >> 56] for value in tables[-1]])
    return np.array(tables, dtype=np.uint64)


_TABLES = _tables()


def crc64(data: bytes | bytearray | memoryview) -> int:
    """Checksum of a message's body: the remainder of data(x) · x⁶⁴ divided by the polynomial of ECMA-182 over GF(2)."""
    return int(_run(np.frombuffer(data, dtype=np.uint8), _TABLES))


@numba.njit(cache=True, nogil=True)
def _run(data: AnyArray, tables: AnyArray) -> np.uint64:
    """Eight bytes at a time."""
    crc = np.uint64(0)
    low, eight, top = np.uint64(255), np.uint64(8), np.uint64(56)
    whole = len(data) // 8 * 8
    for at in range(0, whole, 8):
        word = np.uint64(0)
        for k in range(8):
            word = (word << eight) | np.uint64(data[at + k])
        word ^= crc
        crc = np.uint64(0)
        for k in range(8):
            crc ^= tables[k, word & low]
            word >>= eight
    for at in range(whole, len(data)):
        crc = (crc << eight) ^ tables[0, (crc >> top) ^ np.uint64(data[at])]
    return crc
