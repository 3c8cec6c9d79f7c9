"""Names of structures: what TotalSegmentator calls them, and which of them are body, vertebra, lumbar."""

import difflib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json

BODY_NAMES = ("body_trunc", "body", "trunk", "torso")
"""Names a body may bear, best first: the trunk without arms, as in the paper, before all of the body."""

_REGIONS = {"C": 0, "T": 100, "L": 200, "S": 300}
_VERTEBRA = re.compile(r"vertebrae?_?([CTLS])(\d+)$", re.IGNORECASE)


def _sided(*names: str, order: tuple[str, str] = ("left", "right")) -> list[str]:
    return [f"{name}_{side}" for name in names for side in order]


def _vertebrae(region: str, highest: int) -> list[str]:
    return [f"vertebrae_{region}{number}" for number in range(highest, 0, -1)]


TOTAL_CLASSES: Mapping[int, str] = dict(enumerate([
    "spleen", *_sided("kidney", order=("right", "left")), "gallbladder", "liver", "stomach", "pancreas",
    *_sided("adrenal_gland", order=("right", "left")), "lung_upper_lobe_left", "lung_lower_lobe_left",
    "lung_upper_lobe_right", "lung_middle_lobe_right", "lung_lower_lobe_right", "esophagus", "trachea", "thyroid_gland",
    "small_bowel", "duodenum", "colon", "urinary_bladder", "prostate", *_sided("kidney_cyst"), "sacrum", "vertebrae_S1",
    *_vertebrae("L", 5), *_vertebrae("T", 12), *_vertebrae("C", 7), "heart", "aorta", "pulmonary_vein",
    "brachiocephalic_trunk", *_sided("subclavian_artery", "common_carotid_artery", order=("right", "left")),
    *_sided("brachiocephalic_vein"), "atrial_appendage_left", "superior_vena_cava", "inferior_vena_cava",
    "portal_vein_and_splenic_vein",
    *_sided("iliac_artery", "iliac_vena", "humerus", "scapula", "clavicula", "femur", "hip"), "spinal_cord",
    *_sided("gluteus_maximus", "gluteus_medius", "gluteus_minimus", "autochthon", "iliopsoas"), "brain", "skull",
    *[f"rib_{side}_{number}" for side in ("left", "right") for number in range(1, 13)], "sternum", "costal_cartilages",
], start=1))
"""Class numbers of TotalSegmentator version 2, task "total", as its option ``--ml`` writes them."""


def is_lumbar(name: str) -> bool:
    """Whether `name` is a lumbar vertebra."""
    match = _VERTEBRA.match(name)
    return match is not None and match[1].upper() == "L"


def spine_rank(name: str) -> int | None:
    """Place along the spine, counted from the head; None where the name says nothing of it."""
    if name.lower() in ("sacrum", "coccyx"):
        return 1000 + (name.lower() == "coccyx")
    match = _VERTEBRA.match(name)
    return _REGIONS[match[1].upper()] + int(match[2]) if match else None


def read_names(path: Path | str) -> dict[int, str]:
    """Read a name table: JSON ``{number: name}``, or ``{name: number}``, alone or under the key "labels".

    Raises:
        InputError: absent, not JSON, or not such a table.
    """
    table = read_json(path)
    if isinstance(table, dict) and isinstance(table.get("labels"), dict):
        table = table["labels"]
    try:
        entries = [(value, key) if isinstance(value, int) else (int(key), str(value)) for key, value in table.items()]
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(
            str(path), expected='a table such as {"27": "vertebrae_L5"}', got=f"something else ({error})",
            fix="write one entry a label",
        ) from error
    entries = [(number, name) for number, name in entries if number != 0]
    names = dict(entries)
    if not names or min(names) < 0 or len(set(names.values())) < len(entries) or len(names) < len(entries):
        raise InputError(
            str(path), expected="one name a number", got="an empty table, or a number or name that occurs twice",
            fix="give each label a name of its own",
        )
    return names


def unknown_structure(name: str, known: Iterable[str], *, where: str) -> InputError:
    """The error for a structure that is not there, with the names that come close."""
    known = sorted(known)
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    fix = f"did you mean {', '.join(close)}?" if close else f"choose among {', '.join(known) or 'nothing: it is empty'}"
    return InputError(name, expected=f"a structure of {where}", got="a name that is not there", fix=fix)
