"""Bounds on what a file may ask for: decompression stops at the size that is expected, and memory must be at hand.

A few kilobytes can claim, or decompress to, more than any machine holds. Whoever reads a file says how large its
content can be before it is unpacked, and what is larger is refused as damaged.
"""

import bz2
import lzma
import sys
import zlib
from pathlib import Path
from typing import Any, Literal

from mixpinn.base.errors import InputError

Packing = Literal["gzip", "zlib", "bzip2", "lzma"]
_CHUNK = 1 << 20
_UNKNOWN = 1 << 34
"""Memory that is assumed where the system does not say [byte]."""
_CGROUP = Path("/sys/fs/cgroup")


def memory_at_hand() -> int:
    """Memory that this process can still take [byte]: what the system has free, and what a container allows."""
    free = _from_meminfo()
    try:
        most = int((_CGROUP / "memory.max").read_text())
        used = int((_CGROUP / "memory.current").read_text())
    except (OSError, ValueError):  # no container, or one without a limit
        return free
    return max(0, min(free, most - used))


def _from_meminfo() -> int:
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    return _UNKNOWN


def require_memory(size: int, *, what: str, holds: str, fix: str) -> None:
    """Refuse what does not fit into the memory at hand, before any of it is taken.

    Args:
        size: memory that is needed [byte].
        what: the thing that needs it, as the user names it.
        holds: what it claims to hold, for the message.
        fix: how to mend it.

    Raises:
        InputError: it does not fit.
    """
    free = memory_at_hand()
    if size > free:
        raise InputError(
            what, expected=f"what fits into the memory at hand ({free / 1e9:.1f} GB)",
            got=f"{holds} ({size / 1e9:.3g} GB)", fix=fix,
        )


def unpack(content: bytes | bytearray, packing: Packing, *, most: int) -> bytearray:
    """Decompress all of `content`, which must end where its stream ends; checksums are compared.

    Args:
        content: one stream, of gzip and bzip2 also several one after the other.
        packing: how it was compressed.
        most: largest size that it can have [byte].

    Raises:
        ValueError: damaged, cut short, or larger than `most`.
    """
    view, at = memoryview(content), 0
    whole = bytearray()
    while True:
        stream = _decompressor(packing)
        fed: bytes | memoryview = b""
        while not stream.eof:
            if not fed and getattr(stream, "needs_input", True):
                fed, at = view[at: at + _CHUNK], at + _CHUNK
            ended = not fed and at >= len(view)
            try:
                piece = stream.decompress(fed, min(_CHUNK, most - len(whole) + 1))
            except (zlib.error, lzma.LZMAError, OSError, EOFError, ValueError, MemoryError) as error:
                raise ValueError(str(error) or "damaged") from error
            # zlib hands back what it has not looked at; the others keep it.
            fed = getattr(stream, "unconsumed_tail", b"")
            whole += piece
            if len(whole) > most:
                raise ValueError(f"more than the {most} bytes that it can hold")
            if not piece and ended and not stream.eof:
                raise ValueError("it ends too early")
        at = min(at, len(view)) - len(stream.unused_data)
        if packing == "gzip":  # padding with zeros is allowed behind a member
            while at < len(view) and view[at] == 0:
                at += 1
        if at >= len(view):
            return whole
        if packing not in ("gzip", "bzip2"):
            raise ValueError(f"{len(view) - at} bytes behind its end")


def first_bytes(content: bytes, packing: Packing, count: int) -> bytes:
    """At most the first `count` bytes of what `content` decompresses to; fewer where it is damaged before them."""
    try:
        stream = _decompressor(packing)
        found: bytes = stream.decompress(content, count)
    except (zlib.error, lzma.LZMAError, OSError, EOFError, ValueError):
        return b""
    return found


def _decompressor(packing: Packing) -> Any:
    if packing == "bzip2":
        return bz2.BZ2Decompressor()
    if packing == "lzma":
        return lzma.LZMADecompressor()
    return zlib.decompressobj(16 + zlib.MAX_WBITS if packing == "gzip" else zlib.MAX_WBITS)


def plausible_count(text: str | None, *, most: int = sys.maxsize) -> int:
    """A count that a header states in words.

    Raises:
        ValueError: no whole number from 0 to `most`.
    """
    if text is None or not text.strip().isdecimal() or not text.isascii() or len(text.strip()) > 19:
        raise ValueError(f"{text!r} where a count should stand")
    count = int(text)
    if count > most:
        raise ValueError(f"a count of {count}")
    return count
