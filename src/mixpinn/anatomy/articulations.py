"""Which bones articulate besides vertebrae, by their names."""

import re
from collections.abc import Sequence

_RIB = re.compile(r"rib_(?:left|right)_(\d{1,2})", re.IGNORECASE)
_HIPS = ("hip", "hip_left", "hip_right")
_SACRUM = ("sacrum", "vertebrae_s1")


def are_sacroiliac(first: str, second: str) -> bool:
    """Whether two parts are a hip and the sacrum, or what there is of it."""
    return {first.lower() in _HIPS, second.lower() in _HIPS} == {True, False} and (
        first.lower() in _SACRUM or second.lower() in _SACRUM
    )


def are_costovertebral(first: str, second: str) -> bool:
    """Whether two parts are a rib and the thoracic vertebra of its number."""
    for rib, vertebra in ((first, second), (second, first)):
        match = _RIB.fullmatch(rib)
        if match is not None and vertebra.lower() == f"vertebrae_t{int(match[1])}":
            return True
    return False


def articulating(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Hips with the sacrum, and vertebrae with their ribs; the one that is clamped in an experiment is the first."""
    hips = [(hip, bone) for hip in names if hip.lower() in _HIPS for bone in names if are_sacroiliac(hip, bone)]
    ribs = [(bone, rib) for bone in names for rib in names if _RIB.fullmatch(rib) and are_costovertebral(bone, rib)]
    return (*hips, *ribs)
