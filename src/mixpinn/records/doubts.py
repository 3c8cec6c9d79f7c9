"""Doubts: what was noticed about an anatomy or a mesh, kept with everything that is made from it.

A doubt is one line ``STRUCTURE: KIND: what was seen``, after ``repaired: `` where it has been mended.
"""

from collections.abc import Sequence

from mixpinn.base.arrays import AnyArray
from mixpinn.base.text import escaped, unescaped

REPAIRED = "repaired: "
_MOST = 4
"""Structures that a short list names."""


def in_short(doubts: Sequence[str]) -> str:
    """All doubts in one short line, empty without any: each kind once with its structures.

    Example:
        >>> in_short(["L1: cut off: 229 voxels at the border", "L5: cut off: 3 voxels", "repaired: L4: order: swapped"])
        'cut off (L1, L5); repaired (L4)'
    """
    kinds: dict[str, list[str]] = {}
    for doubt in doubts:
        mended = doubt.startswith(REPAIRED)
        structure, _, rest = doubt.removeprefix(REPAIRED).partition(": ")
        structures = kinds.setdefault("repaired" if mended else rest.partition(": ")[0], [])
        if structure not in structures:
            structures.append(structure)
    return "; ".join(f"{kind} ({_some(structures)})" for kind, structures in kinds.items())


def _some(structures: Sequence[str]) -> str:
    more = len(structures) - _MOST
    return ", ".join(structures[:_MOST]) + (f" and {more} more" if more > 0 else "")


def packed(doubts: Sequence[str]) -> dict[str, list[str]]:
    """As field data of a mesh; nothing without any."""
    return {"doubts": [escaped(doubt) for doubt in doubts]} if doubts else {}


def unpacked(texts: AnyArray | Sequence[str]) -> tuple[str, ...]:
    """What `packed` made, of field data that was read."""
    return tuple(unescaped(text) for text in texts if str(text))
