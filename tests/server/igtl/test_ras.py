"""A point of a vertebra arrives in RAS where the image says, however the image is stored."""

import nibabel as nib
import numpy as np
import pytest

from mixpinn.anatomy.crop import place_in_frame
from mixpinn.anatomy.segmentation import Segmentation, Structure
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Answer, Motion, Source
from mixpinn.server.igtl.damaged import DamagedMessage
from mixpinn.server.igtl.publisher import Frame, Publisher
from mixpinn.server.igtl.ras import RasFrame
from mixpinn.server.igtl.transform import TransformBody, rigid_matrix
from mixpinn.serving.motions import motion_matrices


def _turn(axis, angle):
    from mixpinn.geometry.rotations import rotation_from_vector

    return rotation_from_vector(angle * np.asarray(axis, dtype=float) / np.linalg.norm(axis))


def _affine(codes, *, turn=None, spacing=(1.5, 2.0, 3.0), origin=(-31.0, 12.5, 840.0)):
    """Voxel index to RAS of an image whose axes run towards `codes`, turned as a whole by `turn`."""
    axes = nib.orientations.inv_ornt_aff(nib.orientations.axcodes2ornt(codes), (1, 1, 1))[:3, :3]
    affine = np.eye(4)
    affine[:3, :3] = (np.eye(3) if turn is None else turn) @ axes @ np.diag(spacing)
    affine[:3, 3] = origin
    return affine


AFFINES = {
    "RAS": _affine("RAS"), "LAS": _affine("LAS"), "LPS": _affine("LPS"), "PIR": _affine("PIR"),
    "oblique": _affine("RAS", turn=_turn((1, 2, -1), 0.3)),
    "oblique and mirrored": _affine("LPI", turn=_turn((0.4, -1, 2), 0.35)),
    "oblique and permuted": _affine("SRA", turn=_turn((1, 0.2, 0.1), -0.3)),
}


@pytest.fixture(params=AFFINES.values(), ids=AFFINES.keys())
def anatomy(request):
    """An image of a body with one vertebra, and a mesh whose nodes lie on voxels of the vertebra."""
    mask = np.zeros((24, 20, 16), dtype=bool)
    mask[2:-2, 2:-2, 2:-2] = True
    bone = np.zeros_like(mask)
    bone[9:14, 7:11, 5:9] = True
    segmentation = Segmentation(
        Structure.trim("body", mask), (), (Structure.trim("L3", bone),), request.param, mask.shape,
    )
    label_map = place_in_frame(segmentation)
    voxels = np.argwhere(label_map.mask("L3"))[[0, 7, 30, -1]]
    voxels[1] = voxels[0] + [0, 0, 2]
    points = np.concatenate([voxels, [[1, 1, 1]]]) @ label_map.affine[:3, :3].T + label_map.affine[:3, 3]
    mesh = TissueMesh(
        points, np.array([[0, 1, 2, 3]], np.int32), np.array([1, 1, 1, 1, 0], np.int16), np.zeros(5, bool), ("L3",),
        np.zeros(1, np.int16), world_to_scanner=label_map.world_to_scanner,
    )
    image = nib.Nifti1Image(bone.astype(np.uint8), request.param)
    return mesh, image


def _centre_in_image(image):
    """Centre of the vertebra as any program sees it that reads the image: mean of affine · (i, j, k)."""
    return (np.argwhere(np.asarray(image.dataobj) > 0) @ image.affine[:3, :3].T + image.affine[:3, 3]).mean(axis=0)


def _voxels_in_image(image):
    return np.argwhere(np.asarray(image.dataobj) > 0) @ image.affine[:3, :3].T + image.affine[:3, 3]


def test_nodes_of_a_vertebra_lie_on_its_voxels(anatomy):
    mesh, image = anatomy
    sent = RasFrame.of_mesh(mesh).points(mesh.points[:4])
    seen = _voxels_in_image(image)
    for point in sent:
        assert np.linalg.norm(seen - point, axis=1).min() < 1e-4


def test_a_transform_moves_the_image_of_the_vertebra_to_where_it_is(anatomy):
    mesh, _ = anatomy
    motion = Motion(np.array([1.0, -4.0, 2.0]), np.zeros(3), _turn((0.3, 1.0, -0.2), 0.1))
    world = motion_matrices(mesh, {"L3": motion})[0]
    moved = mesh.points @ world[:3, :3].T + world[:3, 3]
    answer = Answer(mesh, moved - mesh.points, Source.HYBRID_POSE, motions={"L3": motion})
    sent = Publisher(mesh).messages("TRANSFORM", Frame(answer, 17, 3))[0]
    matrix = TransformBody.unpack(sent.content).matrix
    assert (sent.device, sent.timestamp) == ("L3", 17)
    rest = RasFrame.of_mesh(mesh).points(mesh.points[:4])
    arrived = rest @ matrix[:3, :3].T + matrix[:3, 3]
    # (x, y, z) = (R, −A, −S) but for the shift of the origin, whatever the affine.
    expected = rest + (moved - mesh.points)[:4] * [1.0, -1.0, -1.0]
    np.testing.assert_allclose(arrived, expected, atol=1e-3)


def test_pressing_forward_moves_towards_the_front_in_the_image(anatomy):
    mesh, image = anatomy
    forward = Motion(np.array([0.0, -5.0, 0.0]), np.zeros(3), np.eye(3))
    matrix = RasFrame.of_mesh(mesh).motion(motion_matrices(mesh, {"L3": forward})[0])
    centre = _centre_in_image(image)
    np.testing.assert_allclose(matrix[:3, :3] @ centre + matrix[:3, 3], centre + np.array([0.0, 5.0, 0.0]), atol=1e-9)


def test_a_probe_goes_to_ras_and_back(anatomy):
    mesh, _ = anatomy
    frame, turn, tip = RasFrame.of_mesh(mesh), _turn((1, -2, 0.5), 0.7), np.array([12.0, 88.0, -30.0])
    sent = TransformBody.unpack(TransformBody(frame.probe_from_world(turn, tip)).pack()).matrix
    rotation, place = frame.probe_to_world(sent)
    np.testing.assert_allclose(rotation, turn, atol=1e-6)
    np.testing.assert_allclose(place, tip, atol=1e-3)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, -1.0]), 1.05 * np.eye(3), np.zeros((3, 3))])
def test_what_is_no_rigid_placement_is_refused(matrix):
    with pytest.raises(DamagedMessage, match="no rigid placement"):
        RasFrame(np.diag([1.0, -1.0, -1.0, 1.0])).probe_to_world(rigid_matrix(matrix, np.zeros(3)))
