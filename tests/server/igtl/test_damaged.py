"""Whatever comes over the line, it is read or refused: nothing else is raised."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mixpinn.server.igtl.damaged import DamagedMessage, UnusablePeer
from mixpinn.server.igtl.header import HEADER_SIZE, Header
from mixpinn.server.igtl.image import ImageBody
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.ndarray import NdarrayBody
from mixpinn.server.igtl.polydata import PolyDataBody
from mixpinn.server.igtl.status import StatusBody
from mixpinn.server.igtl.string import StringBody
from mixpinn.server.igtl.transform import TransformBody

_BODIES = [
    TransformBody(np.eye(4)), StatusBody(1, 0, "", "fine"), StringBody("skin, µm"),
    NdarrayBody(np.ones((2, 3), dtype=np.float32)), ImageBody(np.zeros((2, 3, 4, 3), dtype=np.float32), np.eye(4)),
    PolyDataBody(np.zeros((3, 3)), np.array([[0, 1, 2]]), {"displacement": np.ones((3, 3)), "size": np.ones(3)}),
]


@pytest.mark.parametrize("body", _BODIES, ids=lambda body: body.TYPE)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_changed_and_cut_bodies_are_read_or_refused(body, data):
    content = bytearray(body.pack())
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(content[:data.draw(st.integers(0, len(content)))])
    with contextlib.suppress(DamagedMessage):
        type(body).unpack(cut)


@pytest.mark.parametrize("body", _BODIES, ids=lambda body: body.TYPE)
def test_bodies_come_back(body):
    assert type(body).unpack(body.pack()).pack() == body.pack()


@settings(deadline=None)
@given(st.binary(min_size=HEADER_SIZE, max_size=HEADER_SIZE))
def test_any_header_is_read_or_refused(data):
    with contextlib.suppress(UnusablePeer):
        Header.unpack(data)


@settings(deadline=None)
@given(st.binary(max_size=80), st.sampled_from([1, 2]))
def test_any_body_is_read_or_refused(body, version):
    from mixpinn.server.igtl.crc64 import crc64

    with contextlib.suppress(DamagedMessage):
        Message.unpack(Header("TRANSFORM", "Probe", 0, len(body), crc64(body), version), body)


def test_a_wrong_checksum_is_refused():
    packed = Message("STRING", "Trust", StringBody("fine").pack()).pack()
    header = Header.unpack(packed[:HEADER_SIZE])
    with pytest.raises(DamagedMessage, match="checksum"):
        Message.unpack(header, packed[HEADER_SIZE:-1] + b"?")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_transform_is_finite(value):
    matrix = np.eye(4)
    matrix[0, 3] = value
    with pytest.raises(DamagedMessage, match="nan or inf"):
        TransformBody.unpack(TransformBody(matrix).pack())


def test_a_polygon_names_points_that_exist():
    content = PolyDataBody(np.zeros((3, 3)), np.array([[0, 1, 3]])).pack()
    with pytest.raises(DamagedMessage, match="point 3 of 3"):
        PolyDataBody.unpack(content)


def test_long_names_are_cut_to_the_fields():
    header = Header.unpack(Header("TRANSFORM", "a" * 40, 0, 0, 0).pack())
    assert header.device == "a" * 20
