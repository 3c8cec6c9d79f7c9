import bz2
import gzip
import lzma
import zlib

import pytest

from mixpinn.base.bounded import first_bytes, memory_at_hand, plausible_count, require_memory, unpack
from mixpinn.base.errors import InputError

TEXT = bytes(range(256)) * 9000
PACKED = {
    "gzip": gzip.compress(TEXT), "zlib": zlib.compress(TEXT), "bzip2": bz2.compress(TEXT), "lzma": lzma.compress(TEXT),
}


@pytest.mark.parametrize("packing", PACKED)
def test_a_whole_stream_is_unpacked_and_no_other(packing):
    packed = PACKED[packing]
    assert unpack(packed, packing, most=len(TEXT)) == TEXT
    assert first_bytes(packed, packing, 300) == TEXT[:300]
    for damaged in (packed[:-1], packed[: len(packed) // 2], b"", b"x" + packed, packed[:-6] + b"\x00" * 6):
        with pytest.raises(ValueError):
            unpack(damaged, packing, most=len(TEXT))


@pytest.mark.parametrize("packing", PACKED)
def test_what_is_larger_than_announced_is_refused(packing):
    with pytest.raises(ValueError, match="more than the 99 bytes"):
        unpack(PACKED[packing], packing, most=99)


def test_several_streams_and_padding():
    assert unpack(gzip.compress(b"ab") + gzip.compress(b"c") + b"\x00\x00", "gzip", most=3) == b"abc"
    assert unpack(bz2.compress(b"ab") + bz2.compress(b"c"), "bzip2", most=3) == b"abc"
    with pytest.raises(ValueError, match="1 bytes behind its end"):
        unpack(zlib.compress(b"ab") + b"c", "zlib", most=9)


def test_memory_that_is_not_there_is_refused_before_it_is_taken():
    require_memory(1, what="a.nii", holds="little", fix="")
    with pytest.raises(InputError, match=r"a\.nii: expected what fits .* got much \(1e\+06 GB\); crop it"):
        require_memory(10**15, what="a.nii", holds="much", fix="crop it")
    assert 0 < memory_at_hand() < 1 << 50


@pytest.mark.parametrize("text", [None, "", "-7", "1e3", "٣", "9" * 30, "2.0", "x"])
def test_counts_are_whole_numbers_from_zero_on(text):
    assert plausible_count(" 12 ") == 12
    with pytest.raises(ValueError):
        plausible_count(text)
    with pytest.raises(ValueError, match="count of 12"):
        plausible_count("12", most=11)
