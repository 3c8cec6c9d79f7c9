"""Reading MetaImage (``.mha``, ``.mhd``) as a label image."""

from pathlib import Path

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.images.label_image import LPS_TO_RAS, LabelImage, file_beside, make_label_image
from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.bounded import unpack
from mixpinn.base.errors import InputError
from mixpinn.records.voxels import check_extents

_TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
_FROM = {
    "R": np.array([1.0, 0.0, 0.0]), "L": np.array([-1.0, 0.0, 0.0]), "A": np.array([0.0, 1.0, 0.0]),
    "P": np.array([0.0, -1.0, 0.0]), "I": np.array([0.0, 0.0, 1.0]), "S": np.array([0.0, 0.0, -1.0]),
}
"""Direction in LPS of an axis that comes from a side."""
_ALONG = 0.5
"""Cosine above which an oblique axis goes where its letter says; the nearest of three has 0.58 at least."""


def read_metaimage(path: Path) -> LabelImage:
    """Read a ``.mha``, or a ``.mhd`` with its data file, as ITK writes them (frame LPS).

    Raises:
        InputError: absent, damaged, of another kind, without an orientation, or not a label map.
    """
    fields, body = _header(path, path.read_bytes())
    if fields.get("ndims") != "3" or fields.get("elementnumberofchannels", "1") != "1":
        raise _bad(path, "a 3-D image of one channel", f"NDims {fields.get('ndims', 'absent')}")
    if not {"transformmatrix", "rotation", "orientation"} & set(fields):
        raise InputError(
            str(path), expected="an orientation (TransformMatrix)",
            got="a header without, so left and right are unknown", fix="write the image with its orientation",
        )
    matrix = next(fields[name] for name in ("transformmatrix", "rotation", "orientation") if name in fields)
    origin = next((fields[name] for name in ("offset", "position", "origin") if name in fields), "0 0 0")
    affine = np.eye(4)
    affine[:3, :3] = (_numbers(path, matrix, 9).reshape(3, 3) * _numbers(path, _spacing(path, fields), 3)[:, None]).T
    affine[:3, 3] = _numbers(path, origin, 3)
    notes = _against_letters(path, affine, fields.get("anatomicalorientation", ""))
    return make_label_image(path, _data(path, fields, body), LPS_TO_RAS @ affine, notes=notes)


def _against_letters(path: Path, affine: FloatArray, told: str) -> tuple[Finding, ...]:
    """An error where AnatomicalOrientation names other directions of the axes than the matrix, in LPS, has.

    ITK writes the sides that the axes come from (RAI for a matrix of ones), other programs those they go to (LPS);
    either is taken. It writes ``???`` where nothing is known.
    """
    letters = told.strip().upper()
    if len(letters) != 3 or not set(letters) <= _FROM.keys():
        return ()
    turn = affine[:3, :3] / np.maximum(np.linalg.norm(affine[:3, :3], axis=0), np.finfo(np.float64).tiny)
    along = np.array([_FROM[letter] @ turn[:, axis] for axis, letter in enumerate(letters)])
    if not np.isfinite(turn).all() or (along >= _ALONG).all() or (along <= -_ALONG).all():
        return ()
    own = "".join(max(_FROM, key=lambda letter: float(_FROM[letter] @ turn[:, axis])) for axis in range(3))
    detail = f"TransformMatrix says {own}, AnatomicalOrientation {letters}: one of the two is wrong"
    return (Finding("affine", path.name, detail, 0, repairable=False, error=True),)


def _bad(path: Path, expected: str, got: str) -> InputError:
    return InputError(str(path), expected=expected, got=got, fix="export it as .nii.gz")


def _spacing(path: Path, fields: dict[str, str]) -> str:
    for name in ("elementspacing", "elementsize"):
        if name in fields:
            return fields[name]
    raise _bad(path, "the spacing of the voxels (ElementSpacing)", "none")


def _header(path: Path, content: bytes) -> tuple[dict[str, str], bytes]:
    """The fields ``Key = value`` up to ElementDataFile, which is the last, and what follows it."""
    fields: dict[str, str] = {}
    at = 0
    while at < len(content) and "elementdatafile" not in fields:
        end = content.find(b"\n", at)
        end = len(content) if end < 0 else end
        key, sign, value = content[at:end].decode("latin-1").partition("=")
        if not sign and key.strip():
            break
        fields[key.strip().lower()] = value.strip()
        at = end + 1
    if "elementdatafile" not in fields:
        raise _bad(path, "a MetaImage header", "another kind of file")
    return fields, content[at:]


def _numbers(path: Path, text: str, count: int) -> FloatArray:
    try:
        values = np.array([float(word) for word in text.split()], dtype=np.float64)
    except ValueError as error:
        raise _bad(path, f"{count} numbers", text) from error
    if len(values) != count:
        raise _bad(path, f"{count} numbers", text)
    return values


def _data(path: Path, fields: dict[str, str], body: bytes | bytearray) -> AnyArray:
    file = fields["elementdatafile"]
    if file.lower() != "local":
        body = file_beside(path, file).read_bytes()
    kind = _TYPES.get(fields.get("elementtype", "").upper())
    header_size = fields.get("headersize", "0")
    if kind is None or fields.get("binarydata", "True").lower() != "true" or header_size != "0":
        raise _bad(path, "binary numbers of one type", fields.get("elementtype", "no ElementType"))
    order = fields.get("elementbyteordermsb", fields.get("binarydatabyteordermsb", "False")).lower()
    dtype = np.dtype(kind).newbyteorder(">" if order == "true" else "<")
    extents = _numbers(path, fields.get("dimsize", ""), 3)
    if not np.isfinite(extents).all():
        raise _bad(path, "numbers of voxels as DimSize", fields["dimsize"])
    sizes = [int(size) for size in extents]
    expected = check_extents(sizes, dtype.itemsize, str(path))
    if fields.get("compresseddata", "False").lower() == "true":
        try:
            body = unpack(body, "zlib", most=expected)
        except ValueError as error:
            raise InputError(
                str(path), expected="a complete MetaImage", got=f"a damaged one ({error})",
                fix="copy or write it again",
            ) from error
    if min(sizes) < 1 or len(body) != expected:
        raise InputError(
            str(path), expected=f"{expected} bytes of voxels", got=f"{len(body)}", fix="copy or write it again",
        )
    data: AnyArray = np.frombuffer(body, dtype=dtype).reshape(sizes, order="F")
    return data
