"""Frames: what is written is read back, to the resolution that the client chose; cut and foreign ones are refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.server.protocol import (
    HEAD,
    Encoding,
    Flag,
    Kind,
    Vertices,
    decode_answer,
    decode_surface,
    encode_answer,
    encode_surface,
)
from mixpinn.serving.live import LiveSession
from serving.live.pressed import above, block_predictor


@pytest.fixture(scope="module")
def found():
    with LiveSession(block_predictor()) as session:
        session.press(above(10.0, 10.0), probe=0, pose_id=5)
        return session.press(above(30.0, 30.0, 2.0), probe=2, pose_id=8)


@pytest.mark.parametrize(("encoding", "atol"), [(Encoding.INT16, 0.5001e-3), (Encoding.FLOAT32, 0.0)])
@pytest.mark.parametrize("skin", [False, True])
def test_a_frame_carries_the_answer(found, encoding, atol, skin) -> None:
    vertices = np.unique(found.answer.mesh.skin_faces) if skin else None
    errors = np.linalg.norm(found.answer.displacement, axis=1)
    frame = decode_answer(encode_answer(found, encoding=encoding, vertices=vertices, kind=Kind.REPLAY, errors=errors))
    chosen = slice(None) if vertices is None else vertices
    assert_allclose(frame.displacement, found.answer.displacement[chosen], atol=atol, rtol=0.0)
    assert_allclose(frame.errors, errors[chosen], atol=1e-4)
    assert (frame.kind, frame.vertices) == (Kind.REPLAY, Vertices.SKIN if skin else Vertices.NODES)
    assert (frame.pose_id, frame.sequence) == (8, found.sequence)
    assert frame.trust.reasons == found.answer.warnings()
    assert frame.trust.expected is None  # the block's bundle is not calibrated
    outside = Flag.OUTSIDE if found.answer.trust.outside else Flag(0)
    assert frame.flags & ~Flag.ERRORS == Flag.CONVERGED | Flag.TOUCHES | outside
    assert_array_equal(frame.probes["index"], [0, 2])
    assert_array_equal(frame.probes["pose_id"], [5, 8])
    assert_allclose(frame.probes["force"], found.answer.force, rtol=1e-6)
    assert_allclose(frame.probes["moment"], found.answer.moment, rtol=1e-6)
    assert_allclose(frame.probes["matrix"][1][:3, 3], above(30.0, 30.0, 2.0).translation, rtol=1e-6)
    assert_allclose(frame.parts["matrix"], found.matrices, rtol=1e-6, atol=1e-6)
    assert_allclose(frame.parts["distance"], [motion.distance for motion in found.answer.motions.values()], rtol=1e-6)


def test_lengths_and_offsets_are_those_of_the_page(found) -> None:
    data = encode_answer(found, encoding=Encoding.NONE)
    assert data[:4] == b"MXLV"
    assert int.from_bytes(data[8:12], "little") == 8
    assert HEAD.fields["time"][1] == 40
    assert HEAD.fields["expected"][1] == 56
    assert HEAD.fields["error_scale"][1] == 88
    assert np.frombuffer(data, "<f4", 3, 96 + 80)[1] == pytest.approx(found.answer.force[0, 1], rel=1e-6)
    assert np.frombuffer(data, "<f4", 1, 96 + 2 * 112 + 64)[0] == pytest.approx(
        found.answer.motions[found.answer.mesh.rigid_names[0]].distance, rel=1e-6,
    )
    assert decode_answer(data).displacement.shape == (0, 3)
    assert len(encode_answer(found, encoding=Encoding.INT16)) % 4 == 0


@pytest.mark.parametrize("cut", [0, 3, 50, 100, -1])
def test_cut_frames_are_refused(found, cut) -> None:
    data = encode_answer(found, encoding=Encoding.INT16)
    with pytest.raises(InputError, match="frame"):
        decode_answer(data[:cut])


def test_other_versions_are_refused(found) -> None:
    data = bytearray(encode_answer(found, encoding=Encoding.NONE))
    data[4] = 9
    with pytest.raises(InputError, match="version 9"):
        decode_answer(bytes(data))


def test_a_surface_comes_back() -> None:
    points = np.random.default_rng(1).normal(size=(5, 3)).astype(np.float32)
    triangles = np.array([[0, 1, 2], [2, 3, 4]])
    data = encode_surface(points, triangles, np.arange(5) + 7)
    for mine, back in zip((points, triangles, np.arange(5) + 7), decode_surface(data), strict=True):
        assert_array_equal(mine, back)
    with pytest.raises(InputError, match="frame"):
        decode_surface(data[:-1])
