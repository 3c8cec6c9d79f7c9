"""Names of structures: what TotalSegmentator calls them, and which of them are body, vertebra, lumbar."""

import difflib
import re
from collections.abc import Iterable, Mapping

from mixpinn.base.errors import InputError

BODY_NAMES = ("body_trunc", "body", "trunk", "torso")
"""Names a body may bear, best first: the trunk without arms, as in the paper, before all of the body."""

_REGIONS = {"C": 0, "T": 100, "L": 200, "S": 300}
_VERTEBRA = re.compile(r"(?:vertebra[e]?[_ ]*)?([CTLS])(\d{1,2})(?:[_ ]+vertebra[e]?)?$", re.IGNORECASE)
_LAST = {"C": (7, 7), "T": (12, 13), "L": (4, 6)}
"""Fewest and most vertebrae of a region, transitional ones included, for what may follow what."""


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


TOTAL_CLASSES_V1: Mapping[int, str] = dict(enumerate([
    "spleen", *_sided("kidney", order=("right", "left")), "gallbladder", "liver", "stomach", "aorta",
    "inferior_vena_cava", "portal_vein_and_splenic_vein", "pancreas", *_sided("adrenal_gland", order=("right", "left")),
    "lung_upper_lobe_left", "lung_lower_lobe_left", "lung_upper_lobe_right", "lung_middle_lobe_right",
    "lung_lower_lobe_right", *_vertebrae("L", 5), *_vertebrae("T", 12), *_vertebrae("C", 7), "esophagus", "trachea",
    "heart_myocardium", "heart_atrium_left", "heart_ventricle_left", "heart_atrium_right", "heart_ventricle_right",
    "pulmonary_artery", "brain", *_sided("iliac_artery", "iliac_vena"), "small_bowel", "duodenum", "colon",
    *[f"rib_{side}_{number}" for side in ("left", "right") for number in range(1, 13)],
    *_sided("humerus", "scapula", "clavicula", "femur", "hip"), "sacrum", "face",
    *_sided("gluteus_maximus", "gluteus_medius", "gluteus_minimus", "autochthon", "iliopsoas"), "urinary_bladder",
], start=1))
"""Class numbers of TotalSegmentator version 1."""

NAMED_TABLES: Mapping[str, Mapping[int, str]] = {"total": TOTAL_CLASSES, "total-v1": TOTAL_CLASSES_V1}
"""Name tables that need no file."""


def is_lumbar(name: str) -> bool:
    """Whether `name` is a lumbar vertebra."""
    match = _VERTEBRA.match(name)
    return match is not None and match[1].upper() == "L"


_BONES = re.compile(
    r"(sacrum|coccyx|sternum|skull|hip(_left|_right)?|femur(_left|_right)?|rib_(left|right)_\d{1,2}"
    r"|(humerus|scapula|clavicula)(_left|_right)?)$", re.IGNORECASE,
)


def is_bone(name: str) -> bool:
    """Whether `name` is a bone, as TotalSegmentator calls them."""
    return _VERTEBRA.match(name) is not None or _BONES.match(name) is not None


_GROUPS: tuple[tuple[str, str], ...] = (
    ("disc", r"(intervertebral_)?dis[ck]s?(_.*)?"),
    ("fat", r"((subcutaneous|torso|intermuscular|visceral)_)?(fat|adipose)(_.*)?"),
    ("muscle", r"(skeletal_)?muscles?(_.*)?|(autochthon|iliopsoas|gluteus_(maximus|medius|minimus))(_left|_right)?"),
    ("organ", r"spleen|kidney(_cyst)?_(left|right)|gallbladder|liver|stomach|pancreas|adrenal_gland_(left|right)"
              r"|small_bowel|duodenum|colon|urinary_bladder|prostate|esophagus"),
)


def tissue_group(name: str) -> str | None:
    """``fat``, ``muscle``, ``organ`` or ``disc`` for a soft tissue, mostly as TotalSegmentator calls them."""
    return next((group for group, pattern in _GROUPS if re.fullmatch(pattern, name, re.IGNORECASE)), None)


def spine_rank(name: str) -> int | None:
    """Place along the spine, counted from the head; None where the name says nothing of it."""
    if name.lower() in ("sacrum", "coccyx"):
        return 1000 + (name.lower() == "coccyx")
    match = _VERTEBRA.match(name)
    return _REGIONS[match[1].upper()] + int(match[2]) if match else None


def vertebrae_between(upper: int, lower: int) -> bool:
    """Whether there must be a vertebra between two places along the spine (see `spine_rank`)."""
    if lower // 100 == upper // 100:
        return lower - upper > 1
    region = next((name for name, start in _REGIONS.items() if start == upper // 100 * 100), None)
    if region not in _LAST:
        return False
    next_region = lower // 100 == upper // 100 + 1 and lower % 100 == 1
    follows = next_region or (region == "L" and lower >= 1000)
    return not follows or upper % 100 < _LAST[region][0]


def unknown_structure(name: str, known: Iterable[str], *, where: str) -> InputError:
    """The error for a structure that is not there, with the names that come close."""
    known = sorted(known)
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    fix = f"did you mean {', '.join(close)}?" if close else f"choose among {', '.join(known) or 'nothing: it is empty'}"
    return InputError(name, expected=f"a structure of {where}", got="a name that is not there", fix=fix)
