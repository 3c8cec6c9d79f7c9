"""What is sent is what the answer says: skin, grid, force and trust in RAS."""

import json

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Answer, Motion, Source, Trust
from mixpinn.server.igtl.devices import part_devices
from mixpinn.server.igtl.grid import DisplacementGrid
from mixpinn.server.igtl.image import ImageBody
from mixpinn.server.igtl.ndarray import NdarrayBody
from mixpinn.server.igtl.polydata import PolyDataBody
from mixpinn.server.igtl.publisher import Frame, Publisher
from mixpinn.server.igtl.ras import RasFrame
from mixpinn.server.igtl.skin import SkinSurface
from mixpinn.server.igtl.string import StringBody
from mixpinn.serving.motions import motion_matrices
from training.toy_block import block_mesh
from validation.kuhn import grid_points, kuhn_cells

TURN = rotation_from_vector(np.array([0.02, -0.05, 0.03]))


@pytest.fixture(scope="module")
def mesh():
    return block_mesh()


def _cube(n, spacing, *, bone=(1.0, -1.0)):
    """n × n × n nodes; those between the two heights on every axis are the wall of a cavity, a rigid part."""
    ticks = spacing * np.arange(n)
    points, cells = grid_points(ticks, ticks, ticks), kuhn_cells((n - 1, n - 1, n - 1))
    hollow = ((points > bone[0]) & (points < bone[1])).all(axis=1)
    kept = ~hollow[cells].all(axis=1)
    return TissueMesh(
        points, cells[kept], hollow.astype(np.int16), points[:, 1] == 0.0, ("bone",), np.zeros(kept.sum(), np.int16),
    )


def _linear(points):
    """A displacement that linear cells hold exactly."""
    return points @ np.array([[0.02, -0.1, 0.0], [0.05, 0.01, -0.03], [0.0, 0.04, 0.06]]) + [0.3, -1.0, 0.2]


def _frame(mesh, **about):
    return Frame(Answer(mesh, _linear(mesh.points), Source.HYBRID_POSE, **about), 5, 1)


def test_the_skin_lies_where_the_answer_says(mesh):
    message = Publisher(mesh).messages("POLYDATA", _frame(mesh))[0]
    surface, frame = PolyDataBody.unpack(message.content), RasFrame.of_mesh(mesh)
    nodes = np.unique(mesh.skin_faces)
    moved = _linear(mesh.points[nodes])
    np.testing.assert_allclose(surface.points, frame.points(mesh.points[nodes] + moved), atol=1e-4)
    np.testing.assert_allclose(surface.attributes["displacement_mm"], np.linalg.norm(moved, axis=1), rtol=1e-6)
    np.testing.assert_array_equal(nodes[surface.polygons], mesh.skin_faces)


def test_a_thinned_skin_keeps_nodes_of_the_mesh_and_faces_outward():
    mesh = _cube(9, 5.0)
    frame = RasFrame.of_mesh(mesh)
    full, thin = SkinSurface(mesh, frame), SkinSurface(mesh, frame, most_points=200)
    assert len(thin.nodes) < 210 < len(full.nodes)
    assert set(thin.nodes) <= set(full.nodes)
    surface = PolyDataBody.unpack(thin.content(np.zeros_like(mesh.points)))
    corners = surface.points[surface.polygons].astype(float)
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    assert volume == pytest.approx(40.0**3, rel=0.1)  # positive: outward, closed


def test_the_grid_takes_soft_tissue_exactly_and_rigid_parts_with_their_motion(mesh):
    motions = {"L1": Motion(np.array([0.5, -2.0, 0.1]), np.zeros(3), TURN)}
    grid, frame = DisplacementGrid(mesh, RasFrame.of_mesh(mesh), spacing=7.3), RasFrame.of_mesh(mesh)
    image = ImageBody.unpack(grid.image(_linear(mesh.points), motions).pack())
    nk, nj, ni = image.voxels.shape[:3]
    k, j, i = np.meshgrid(np.arange(nk), np.arange(nj), np.arange(ni), indexing="ij")
    ras = np.stack([i, j, k], axis=-1) @ image.matrix[:3, :3].T + image.matrix[:3, 3]
    world = frame.probe_to_world(np.eye(4))[0] @ ras.reshape(-1, 3).T
    world = world.T
    inside = ((world > 0.01) & (world < 39.99)).all(axis=1)
    matrix = motion_matrices(mesh, motions)[0]
    moved = world @ matrix[:3, :3].T + matrix[:3, 3] - world
    sent = image.voxels.reshape(-1, 3)
    # Rigid parts of this block are no cavities but nodes of cells: there the cell's interpolation counts.
    np.testing.assert_allclose(sent[inside], frame.vectors(_linear(world))[inside], atol=1e-4)
    assert not sent[~inside & ((world < -0.01) | (world > 40.01)).any(axis=1)].any()
    assert np.abs(moved).max() > 1.0


def test_a_voxel_in_a_cavity_moves_with_its_part():
    mesh = _cube(6, 10.0, bone=(15.0, 35.0))
    motions = {"bone": Motion(np.array([0.5, -2.0, 0.1]), np.zeros(3), TURN)}
    frame = RasFrame.of_mesh(mesh)
    image = DisplacementGrid(mesh, frame, spacing=5.0).image(np.zeros_like(mesh.points), motions)
    index = np.rint(np.linalg.inv(image.matrix) @ [*frame.points([[25.0, 25.0, 25.0]])[0], 1.0]).astype(int)
    np.testing.assert_allclose(image.voxels[index[2], index[1], index[0]], frame.vectors([0.5, -2.0, 0.1]), atol=1e-5)


def test_force_and_trust(mesh):
    trust = Trust(0.02, 0.05, 0.95, True, ("deeper than what was learned from",))
    frame = _frame(mesh, force=np.array([[1.0, 2.0, 3.0]]), moment=np.array([[4.0, 5.0, 6.0]]), trust=trust)
    publisher = Publisher(mesh)
    rows = NdarrayBody.unpack(publisher.messages("NDARRAY", frame)[0].content).array
    np.testing.assert_array_equal(rows, [[1.0, -2.0, -3.0, 4.0, -5.0, -6.0]])
    said = json.loads(StringBody.unpack(publisher.messages("STRING", frame)[0].content).text)
    assert (said["sound"], said["bound_mm"], said["reasons"]) == (False, 0.05, ["deeper than what was learned from"])
    assert said["force_N"] == [3.742]


def test_at_rest_nothing_is_moved(mesh):
    publisher, rest = Publisher(mesh), Frame(None)
    assert [message.device for message in publisher.messages("TRANSFORM", rest)] == ["L1", "L2"]
    assert not ImageBody.unpack(publisher.messages("IMAGE", rest)[0].content).voxels.any()


def test_names_that_cannot_be_told_apart_are_refused():
    assert part_devices(("vertebrae_L1", "a" * 30)) == {"vertebrae_L1": "vertebrae_L1", "a" * 30: "a" * 20}
    with pytest.raises(InputError, match="first 20 letters"):
        part_devices(("a" * 21, "a" * 22))
    with pytest.raises(InputError, match="Skin"):
        part_devices(("Skin",))


@pytest.mark.parametrize(("about", "named"), [({"skin_points": 3}, "skin points"), ({"spacing": 0.0}, "grid")])
def test_settings_are_checked(mesh, about, named):
    with pytest.raises(InputError, match=named):
        Publisher(mesh, **about).messages("IMAGE", Frame(None))
