"""Text as people's programs write it: byte order marks, UTF-16, old Windows code pages; the same on any machine."""

import codecs
from pathlib import Path

from mixpinn.base.errors import InputError

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"),
)


def read_text(path: Path | str, *, expected: str) -> str:
    """The text of a file: UTF-8, else what its byte order mark says, else Windows' Western code page.

    Args:
        path: the file.
        expected: what it should be, for messages.

    Raises:
        InputError: absent, unreadable, or no text.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(str(path), expected=expected, got="no such file", fix="check the path") from error
    except OSError as error:
        raise InputError(
            str(path), expected=expected, got=error.strerror or str(error), fix="check the path",
        ) from error
    return decode_text(content, what=str(path), expected=expected)


def escaped(text: str) -> str:
    """The text in ASCII, other characters as Python escapes them."""
    return text.encode("unicode_escape").decode("ascii")


def unescaped(text: object) -> str:
    """What `escaped` was given.

    Raises:
        UnicodeDecodeError: an escape that is none.
    """
    return str(text).encode("latin-1", "backslashreplace").decode("unicode_escape")


def decode_text(content: bytes, *, what: str, expected: str) -> str:
    """The text in `content`, as `read_text` reads it.

    Raises:
        InputError: no text.
    """
    fix = "save it as UTF-8 text"
    encoding = next((name for mark, name in _MARKS if content.startswith(mark)), None)
    try:
        if encoding is not None:
            return content.decode(encoding)
        if b"\x00" not in content:
            try:
                return content.decode("utf-8")
            except UnicodeDecodeError:
                return content.decode("cp1252")
    except UnicodeDecodeError as error:
        raise InputError(what, expected=expected, got=f"text that cannot be decoded ({error})", fix=fix) from error
    raise InputError(what, expected=expected, got="a binary file", fix=fix)
