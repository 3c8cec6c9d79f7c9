"""Inputs that once got past the readers' checks: each is an answer or one line now."""

import json

import numpy as np
import pytest

from drill.fuzz_bundles import FIRST_DESCRIBED
from drill.fuzz_readers import READERS
from drill.odd_files import metaimage, nifti, nrrd
from mixpinn.base.errors import InputError

AXES = np.eye(3).tolist()


def with_unit(code):
    content = bytearray(nifti())
    content[123] = code
    return bytes(content)


def with_dimensions(count):
    content = bytearray(nifti())
    content[40] = count
    return bytes(content)


def joint(**entries):
    frame = {"first": "a", "second": "b", "origin": [0, 0, 0], "axes": AXES, "spacing": 1} | entries
    return json.dumps({"joints": [frame]}).encode()


LAYERS = nrrd("1 9 9 9").replace(b"dimension: 3", b"dimension: 4").replace(b"(5,0,0)", b"")
ELSEWHERE = nrrd().replace(b"raw\n", b"raw\ndata file: " + b"a" * 5000 + b"\n")
HISTORY = b"\x09epoch,train_loss,validation_loss,learning_rate,seconds\n"
NO_MODES = json.dumps({"about": None, "arrays": {
    "coupling": ["float32", [0, 48]], "duals": ["float32", [0, 126]], "gain": ["float32", [5, 0]],
    "modes": ["float32", [0, 126]], "readers": ["float32", [0, 48]],
}}).encode()
NO_AXIS = ["int64", [], [0]]


def handed(kind, **arrays):
    """What a child hands over of a grid (4) or a surface (5): of each array type, shape and numbers."""
    none = {"point_data": [], "cell_data": [], "field_data": [], "text": {}}
    return bytes([kind]) + json.dumps({"arrays": arrays, "about": none}).encode()


POINTS = ["float64", [4, 3], [0, 0, 0, 9, 0, 0, 0, 9, 0, 0, 0, 9]]
CELL = {"connectivity": ["int64", [4], [0, 1, 2, 3]], "offsets": ["int64", [2], [0, 4]], "types": ["uint8", [1], [10]]}
FOUND = {
    "a number instead of triangles": ("foreign", handed(5, points=POINTS, triangles=NO_AXIS)),
    "a number instead of vertices": ("foreign", handed(5, points=NO_AXIS, triangles=["int64", [1, 3], [0]])),
    "a number instead of types": ("foreign", handed(4, points=POINTS, **CELL | {"types": NO_AXIS})),
    "a number instead of points": ("foreign", handed(4, points=NO_AXIS, **CELL)),
    "a regression on features that there are none of": ("bundles", bytes([FIRST_DESCRIBED]) + NO_MODES),
    "directions for fewer axes": ("labels", b"\x02" + LAYERS),
    "no dimension": ("labels", b"\x02NRRD0004\ndimension: 0\nsizes:\n\n"),
    "extents that are no numbers": ("labels", b"\x03" + metaimage("nan 9 9")),
    "a slice instead of a volume": ("labels", b"\x00" + with_dimensions(2)),
    "a unit that no header has": ("labels", b"\x00" + with_unit(7)),
    "a name longer than any file's": ("labels", b"\x03" + metaimage().replace(b"LOCAL", b"a" * 5000)),
    "a name with a zero": ("labels", b"\x03" + metaimage().replace(b"LOCAL", b"a\x00b")),
    "a NRRD beside it with a long name": ("labels", b"\x02" + ELSEWHERE),
    "a cell without end": ("tables", b'\x00node,dx,dy,dz\n"' + b"a" * 200_000),
    "a label of 5000 digits": ("tables", b"\x04" + b"9" * 5000 + b' 0 0 0 1 1 1 "liver"\n'),
    "a colour table of 5000 digits": ("tables", b"\x04" + b"9" * 5000 + b" liver 1 1 1 1\n"),
    "an epoch without end": ("tables", HISTORY + b'"' + b"1" * 200_000),
    "brackets without end": ("tables", b"\x01" + b"[" * 100_000),
    "a number of 6000 digits": ("tables", b"\x08" + b'{"train": [' + b"9" * 6000 + b"]}"),
    "an origin beyond every number": ("meshes", joint(origin=[10**400, 0, 0])),
    "a spacing beyond every number": ("meshes", joint(spacing=10**400)),
}


@pytest.mark.parametrize("name", FOUND)
def test_found(tmp_path, name):
    reader, content = FOUND[name]
    with pytest.raises(InputError) as caught:
        READERS[reader](tmp_path, content)
    assert "\n" not in str(caught.value)
