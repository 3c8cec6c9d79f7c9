"""Reading NIfTI, one file or a pair, as a label image, with everything that can be wrong said in one line."""

import io
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.anatomy.images.label_image import LabelImage, make_label_image
from mixpinn.anatomy.images.nifti_affine import nifti_affine
from mixpinn.base.errors import InputError
from mixpinn.records.voxels import nifti_claim, nifti_content, nifti_head

if TYPE_CHECKING:
    import nibabel as nib

_MAGIC = {348: (344, b"n+1", b"ni1"), 540: (4, b"n+2", b"ni2")}
"""Size of the header of NIfTI 1 and 2: where its magic starts, and the magic of one file and of a pair."""


def read_nifti(path: Path) -> LabelImage:
    """Read a ``.nii``, ``.nii.gz`` or a pair ``.hdr`` and ``.img``, of any byte order, as a label image.

    Names are those of the header's extension, as TotalSegmentator and Connectome Workbench write them.

    Raises:
        InputError: absent, damaged, not a NIfTI, not three-dimensional, without a usable affine, or with values that
            are not whole non-negative numbers.
    """
    image = open_nifti(path)
    affine, notes = nifti_affine(path, image)
    try:
        data = np.asarray(image.dataobj)
    except Exception as error:  # nibabel lets through what NumPy and zlib raise
        raise _damaged(path, error) from error
    return make_label_image(path, data, affine, names=_extension_names(image), notes=notes)


def pair_of(path: Path) -> tuple[Path, Path] | None:
    """Header and data file of the pair that `path` belongs to; None where it is a file of its own."""
    lower = path.name.lower()
    for zipped in ("", ".gz"):
        for suffix, other in ((".hdr", ".img"), (".img", ".hdr")):
            if lower.endswith(suffix + zipped):
                stem = path.name[: len(path.name) - len(suffix + zipped)].lower()
                wanted = {stem + other + end for end in ("", ".gz")}
                beside = sorted(p for p in path.parent.iterdir() if p.name.lower() in wanted)
                if not beside:
                    raise InputError(
                        str(path), expected=f"its other half ({stem}{other})", got="no such file",
                        fix="keep the .hdr and the .img of a pair together",
                    )
                return (path, beside[0]) if suffix == ".hdr" else (beside[0], path)
    return None


def open_nifti(path: Path) -> "nib.Nifti1Image":
    """A NIfTI in memory, unpacked to no more than its header claims, its gzip checksum compared.

    Raises:
        InputError: damaged, or another kind of file.
    """
    import nibabel as nib

    pair = pair_of(path)
    content = nifti_head(pair[0] if pair else path)
    size = next((n for n in _MAGIC for order in ("little", "big")
                 if int.from_bytes(content[:4], order) == n), None)
    kind, of_pair = (nib.Nifti2Image, nib.Nifti2Pair) if size == 540 else (nib.Nifti1Image, nib.Nifti1Pair)
    start, single, double = _MAGIC[size or 348]
    magic = content[start:start + 3]
    if magic not in (single, double):
        plain = "an Analyze image, which does not say left from right" if size == 348 else "another kind of file"
        raise InputError(str(path), expected="a NIfTI image", got=plain, fix="convert it to .nii.gz")
    try:
        with _one_line():
            claim = nifti_claim(kind, content, str(path))
            if pair is None:
                return kind.from_stream(io.BytesIO(nifti_content(path, most=claim)))
            halves = zip(("header", "image"), pair, strict=True)
            files = {name: nifti_content(part, most=claim) for name, part in halves}
            return of_pair.from_file_map(
                {name: nib.FileHolder(fileobj=io.BytesIO(part)) for name, part in files.items()},
            )
    except InputError:
        raise
    except Exception as error:
        raise _damaged(path, error) from error


@contextmanager
def _one_line() -> Iterator[None]:
    """nibabel says nothing of its own: what matters of a header is looked at and told here."""
    from nibabel import imageglobals

    logger = imageglobals.logger
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _extension_names(image: "nib.Nifti1Image") -> dict[int, str]:
    """Names of the numbers in an XML extension of the header: ``<Label Key="27">vertebrae_L5</Label>``."""
    names: dict[int, str] = {}
    for extension in image.header.extensions:
        try:
            content = extension.get_content()
        except Exception:  # nibabel hands extensions of other programs to their own readers
            continue
        text = content if isinstance(content, bytes) else str(content).encode()
        text = text.strip(b"\x00 \r\n\t")
        if b"<Label" not in text or b"<!DOCTYPE" in text or b"<!ENTITY" in text:
            continue
        try:
            labels = list(ElementTree.fromstring(text).iter("Label"))
            names.update({int(label.attrib["Key"]): (label.text or "").strip() for label in labels})
        except (ElementTree.ParseError, KeyError, ValueError):
            continue  # an extension of another program
    return {number: name for number, name in names.items() if number != 0 and name}


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError(
        str(path), expected="a complete NIfTI file", got=f"a damaged one ({error})", fix="copy or write it again",
    )
