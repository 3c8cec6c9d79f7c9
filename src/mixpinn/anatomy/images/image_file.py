"""Which files are label images, and which reader is for which."""

from collections.abc import Callable
from pathlib import Path

from mixpinn.anatomy.images.dicom_seg import is_dicom, read_dicom_seg
from mixpinn.anatomy.images.label_image import LabelImage
from mixpinn.anatomy.images.metaimage import read_metaimage
from mixpinn.anatomy.images.nifti import pair_of, read_nifti
from mixpinn.anatomy.images.nrrd import read_nrrd
from mixpinn.base.errors import InputError

IMAGE_SUFFIXES = (
    ".nii.gz", ".nii", ".seg.nrrd", ".nrrd", ".nhdr", ".mha", ".mhd", ".hdr.gz", ".hdr", ".img.gz", ".img",
)
"""Endings of label images, in upper or lower case; longer ones first."""

_OTHERS = {".mgz": "FreeSurfer", ".mgh": "FreeSurfer", ".gipl": "GIPL", ".mnc": "MINC", ".tif": "TIFF",
           ".tiff": "TIFF", ".stl": "a surface", ".zip": "an archive"}


def read_label_image(path: Path | str) -> LabelImage:
    """Read a NIfTI (one file or a pair), NRRD, MetaImage or DICOM segmentation as a label image in the frame RAS.

    Raises:
        InputError: absent, damaged, of another kind, not three-dimensional, without a usable affine, or with values
            that are not whole non-negative numbers.
    """
    path = Path(path)
    if not path.is_file():
        if path.is_symlink() and not path.exists():
            raise InputError(
                str(path), expected="a label image", got="a link to a file that is not there",
                fix="fetch the file (git annex get, dvc pull), or remove the link",
            )
        raise InputError(str(path), expected="a label image", got="no such file", fix="check the path")
    if not path.stat().st_size:
        raise InputError(str(path), expected="a label image", got="an empty file", fix="copy or write it again")
    suffix = path.suffix.lower()
    if suffix in _OTHERS:
        raise InputError(
            str(path), expected="a label image (.nii.gz, .nrrd, .mha)", got=f"{_OTHERS[suffix]} ({suffix})",
            fix="convert it with 3D Slicer or SimpleITK",
        )
    return _reader(path)(path)


def structure_name(path: Path) -> str:
    """Name of the structure in a file: the file's name without the endings of label images."""
    lower = path.name.lower()
    for suffix in IMAGE_SUFFIXES:
        if lower.endswith(suffix):
            return path.name[: -len(suffix)]
    return path.name.removesuffix(".gz").removesuffix(".nii")


def label_files(folder: Path) -> dict[str, Path]:
    """The label images of a folder by the names of their structures; a pair counts once, hidden files do not count.

    Raises:
        InputError: one structure in two files.
    """
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        lower = path.name.lower()
        if path.name.startswith(".") or not lower.endswith(IMAGE_SUFFIXES):
            continue
        if path.exists() and not path.is_file():  # but a link to nothing, which is told when it is read
            continue
        if lower.endswith((".img", ".img.gz")) and pair_of(path) is not None:
            continue  # counted by its header
        name = structure_name(path)
        if name in found:
            raise InputError(
                str(folder), expected="one file a structure", got=f"{found[name].name} and {path.name}",
                fix="keep one of them",
            )
        found[name] = path
    return found


def _reader(path: Path) -> Callable[[Path], LabelImage]:
    lower = path.name.lower()
    if lower.endswith((".mha", ".mhd")):
        return read_metaimage
    if lower.endswith(".dcm") or is_dicom(path):
        return read_dicom_seg
    with path.open("rb") as file:
        start = file.read(8)
    return read_nrrd if start.startswith(b"NRRD") else read_nifti
