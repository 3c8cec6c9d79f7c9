"""Finding: one thing that is wrong with an anatomy, or was; and which of them make it unusable."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from mixpinn.base.errors import InputError
from mixpinn.records.doubts import REPAIRED

Kind = Literal[
    "order", "island", "hole", "touch", "overlap", "outside", "exposed", "cut off", "affine", "grid", "values", "scale",
    "direction", "numbering", "size", "missing", "table", "part",
    "layer",
]
ACCEPTABLE: tuple[Kind, ...] = ("affine", "scale", "direction", "numbering", "cut off")
"""Kinds of error that rest on what is usual, and that a user who knows better may accept by name."""

_ADVICE: dict[Kind, tuple[str, str]] = {
    "overlap": ("structures that share no voxel", "segment them again or ask for repair"),
    "outside": ("a rigid part inside the body", "check that both belong to one image, or ask for repair"),
    "affine": ("a header that says one thing", "write the image again with the one that is right"),
    "scale": ("lengths of a human body in mm", "write the image's spacing in mm"),
    "direction": (
        "a body as its matrix places it: head up, spine at the back, left on the left",
        "write the image's matrix in RAS",
    ),
    "numbering": ("numbers that mean what the name table says", "give --names with the table of this image"),
    "cut off": ("skin on the side that is pressed", "reconstruct the image with a larger field of view"),
}


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or was.

    Attributes:
        kind: "order" (vertebrae not in sequence along the spine), "island" (a smaller component), "hole" (enclosed
            background), "touch" (two rigid parts in adjacent voxels), "overlap" (two structures in one voxel),
            "outside" (voxels outside the body), "exposed" (a rigid part at the body's surface), "cut off" (the
            structure reaches the image's border), "affine" (the header contradicts itself), "grid" (masks on grids
            that differ), "values" (labels that were rounded), "scale" (lengths of no human body), "direction" (the
            spine lies in front, or is upside down), "numbering" (structures that are not what the name table calls
            them), "size" (a vertebra unlike its neighbours), "missing" (one that should be there, or too many), "table"
            (something behind the back that belongs to the body's mask), "part" and "layer" (nothing wrong: what a
            bone is taken as, and what of a tissue a mesh can hold).
        structure: its name, or two names joined by " and ".
        detail: what was seen, in words.
        voxels: how many voxels are concerned.
        repairable: whether `repair` mends it.
        error: whether it makes the anatomy unusable as it is.
        repaired: whether it has been mended.
    """

    kind: Kind
    structure: str
    detail: str
    voxels: int
    repairable: bool = True
    error: bool = False
    repaired: bool = False

    @property
    def lasting(self) -> bool:
        """Whether it stays with what is made of the anatomy: what is left, and a rigid part that is not as it was."""
        if self.kind == "part":
            return not self.detail.startswith("rigid: ")
        return not self.repaired or self.kind not in ("hole", "touch")

    @property
    def doubt(self) -> str:
        """As `mixpinn.records.doubts` has it."""
        return (REPAIRED if self.repaired else "") + f"{self.structure}: {self.kind}: {self.detail}"

    def __str__(self) -> str:
        if self.kind in ("part", "layer"):
            return f"{self.structure}: {self.detail}"
        state = "repaired" if self.repaired else "error" if self.error else "warning"
        return f"{state}: {self.structure}: {self.kind}: {self.detail}"


def require_sound(findings: Sequence[Finding], *, accept: Collection[str] = ()) -> None:
    """Refuse an anatomy with errors left.

    Args:
        findings: what was found.
        accept: kinds of `ACCEPTABLE` that the user takes as warnings.

    Raises:
        InputError: the first finding that is an error, was not repaired and is not accepted.
    """
    for finding in findings:
        if not finding.error or finding.repaired or (finding.kind in ACCEPTABLE and finding.kind in accept):
            continue
        expected, fix = _ADVICE.get(finding.kind, ("a sound label map", "ask for repair"))
        if finding.kind in ACCEPTABLE:
            fix += f""", or accept it with --set 'accept=["{finding.kind}"]'"""
        elif not finding.repairable:
            fix = "segment it again or leave it out"
        raise InputError(finding.structure, expected=expected, got=finding.detail, fix=fix)
