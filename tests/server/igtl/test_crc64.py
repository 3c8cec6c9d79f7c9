import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mixpinn.server.igtl.crc64 import crc64

_POLYNOMIAL = (1 << 64) | 0x42F0E1EBA9EA3693  # ECMA-182, annex B


def _remainder(data):
    """By the definition: long division of data(x) · x⁶⁴ over GF(2)."""
    value = int.from_bytes(data, "big") << 64
    for degree in range(value.bit_length() - 1, 63, -1):
        if value >> degree & 1:
            value ^= _POLYNOMIAL << (degree - 64)
    return value


@settings(deadline=None)
@given(st.binary(max_size=60))
def test_is_the_remainder_of_a_division(data):
    assert crc64(data) == _remainder(data)


def test_is_the_catalogued_check_value():
    # "CRC-64/ECMA-182" of the nine digits, as catalogues of checksums list it.
    assert crc64(b"123456789") == 0x6C40DF5F0B497347


@settings(deadline=None)
@given(st.binary(min_size=1, max_size=40), st.integers(0, 10_000))
def test_sees_every_single_flipped_bit(data, where):
    flipped = bytearray(data)
    flipped[where // 8 % len(data)] ^= 1 << where % 8
    assert crc64(flipped) != crc64(data)


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_takes_any_bytes(kind):
    assert crc64(kind(b"12345678abc")) == _remainder(b"12345678abc")
