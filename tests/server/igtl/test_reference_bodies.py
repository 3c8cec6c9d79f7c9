"""Every type as the protocol's own test data have it.

The values and bytes are those of OpenIGTLink's library, ``Testing/igtlutil/igtl_test_data_*.h`` and the tests beside
them, https://github.com/openigtlink/OpenIGTLink: the numbers that a program has to write, digit by digit.
"""

import struct

import numpy as np
import pytest

from mixpinn.server.igtl.header import HEADER_SIZE, Header
from mixpinn.server.igtl.image import ImageBody
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.ndarray import NdarrayBody
from mixpinn.server.igtl.polydata import PolyDataBody
from mixpinn.server.igtl.status import StatusBody, StatusCode
from mixpinn.server.igtl.string import StringBody
from mixpinn.server.igtl.transform import TransformBody, rigid_matrix

_COLUMNS = np.array([
    [-0.954892, 0.196632, -0.222525], [-0.196632, 0.142857, 0.970014], [0.222525, 0.970014, -0.0977491],
])
_PLACE = [46.0531, 19.4709, 46.0531]
_MATRIX_HEX = """
    BF7473CD 3E4959E6 BE63DD98 BE4959E6 3E12491B 3F7852D6 3E63DD98 3F7852D6 BDC830AE 42383660 419BC467 42383660
"""
_DEVICE = "44657669 63654E61 6D650000 00000000 00000000"


def _bytes(text):
    return bytes.fromhex("".join(text.split()))


def _reference(kind, time, size, crc, version="0001"):
    return _bytes(f"{version} {kind} {_DEVICE} 00000000 {time} {size} {crc}")


def _floats(values, code):
    return b"".join(struct.pack(code, value) for value in values)


@pytest.fixture
def matrix():
    return rigid_matrix(_COLUMNS.T, _PLACE)


def _sent(body, *, seconds):
    return Message(body.TYPE, "DeviceName", body.pack(), seconds).pack()


def test_transform(matrix):
    header = _reference("5452414E53464F524D000000", "499602D2", "0000000000000030", "F6DD2B8EB4DF6DD2")
    assert _sent(TransformBody(matrix), seconds=1234567890) == header + _bytes(_MATRIX_HEX)


def test_transform_with_extended_header_and_metadata(matrix):
    header = _reference("5452414E53464F524D000000", "499602D4", "0000000000000075", "F698F64FDAE266DD", "0002")
    index = "0002 0011 0003 00000002 0012 0003 00000002"
    texts = b"First patient age" + b"22" + b"Second patient age" + b"25"
    expected = header + _bytes("000C 0012 00000027 00000001") + _bytes(_MATRIX_HEX) + _bytes(index) + texts
    message = Message(
        "TRANSFORM", "DeviceName", TransformBody(matrix).pack(), 1234567892, version=2, number=1,
        metadata={"First patient age": "22", "Second patient age": "25"},
    )
    assert message.pack() == expected
    read = Message.unpack(Header.unpack(expected[:HEADER_SIZE]), expected[HEADER_SIZE:])
    assert read == message
    np.testing.assert_allclose(TransformBody.unpack(read.content).matrix, matrix, atol=1e-5)


def test_status():
    header = _reference("535441545553000000000000", "499602D4", "0000000000000036", "98EE43EED8E431CF")
    content = _bytes("000F 000000000000000A") + b"ACTUATOR_DISABLED\0\0\0" + b"Actuator A is disabled.\0"
    body = StatusBody(StatusCode.DISABLED, 10, "ACTUATOR_DISABLED", "Actuator A is disabled.")
    assert _sent(body, seconds=1234567892) == header + content
    assert StatusBody.unpack(content) == body


def test_string():
    header = _reference("535452494E47000000000000", "499602D4", "000000000000001A", "CEF1B42A701104D4")
    content = _bytes("0003 0016") + b"Welcome to OpenIGTLink"
    assert _sent(StringBody("Welcome to OpenIGTLink"), seconds=1234567892) == header + content
    assert StringBody.unpack(content).text == "Welcome to OpenIGTLink"


def test_ndarray():
    header = _reference("4E4441525241590000000000", "499602D4", "00000000000001E8", "1BE0CE29554F9A92")
    content = _bytes("0B 03 0005 0004 0003") + _floats(range(60), ">d")
    array = np.arange(60.0).reshape(5, 4, 3)
    assert _sent(NdarrayBody(array), seconds=1234567892) == header + content
    np.testing.assert_array_equal(NdarrayBody.unpack(content).array, array)


def test_polydata():
    header = _reference("504F4C594441544100000000", "499602D4", "000000000000012C", "73DDDFC80C48C62B")
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    polygons = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    content = (
        _bytes("00000008 00000000 00000000 00000000 00000000 00000006 00000078 00000000 00000000 00000001")
        + _floats(np.ravel(points), ">f") + _floats([n for face in polygons for n in (4, *face)], ">I")
        + _bytes("00 01 00000008") + b"attr\0\0" + _floats(range(8), ">f")
    )
    body = PolyDataBody(np.array(points, dtype=float), np.array(polygons), {"attr": np.arange(8.0)})
    assert _sent(body, seconds=1234567892) == header + content
    read = PolyDataBody.unpack(content)
    np.testing.assert_array_equal(read.points, points)
    np.testing.assert_array_equal(read.polygons, polygons)
    np.testing.assert_array_equal(read.attributes["attr"], np.arange(8.0))


def test_image(matrix):
    # The reference is a picture of 50 × 50 pixels; its pixels, any bytes here, follow the 72 that say what they are.
    about = _bytes(f"0001 01 03 02 01 0032 0032 0001 {_MATRIX_HEX} 0000 0000 0000 0032 0032 0001")
    voxels = np.random.default_rng(1).integers(0, 256, (1, 50, 50)).astype(np.uint8)
    corner = matrix.copy()
    corner[:3, 3] -= 24.5 * (matrix[:3, 0] + matrix[:3, 1])  # the reference's place is that of the centre
    message = _sent(ImageBody(voxels, corner), seconds=1234567890)
    header = _reference("494D41474500000000000000", "499602D2", "0000000000000A0C", "0000000000000000")
    assert message[:50] == header[:50]
    assert message[HEADER_SIZE:] == about + voxels.tobytes()
    read = ImageBody.unpack(message[HEADER_SIZE:])
    np.testing.assert_array_equal(read.voxels, voxels)
    np.testing.assert_allclose(read.matrix, corner, atol=1e-5)
