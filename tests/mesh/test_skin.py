import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.mesh import load_paper_mesh, probe_positions, skin_height

from .shapes import box_mesh


def test_height_of_a_box_and_beside_it():
    height = skin_height(box_mesh(), np.array([[0.0, 0.0], [13.0, -7.0], [25.0, 0.0]]))
    assert height[:2] == pytest.approx([20.0, 20.0])
    assert np.isnan(height[2])


def test_height_of_a_tilted_back_is_linear():
    mesh = box_mesh()
    mesh.points[:, 1] += 0.3 * mesh.points[:, 0] - 0.2 * mesh.points[:, 2]
    xz = np.random.default_rng(0).uniform(-19.0, 19.0, (20, 2))
    assert skin_height(mesh, xz) == pytest.approx(20.0 + 0.3 * xz[:, 0] - 0.2 * xz[:, 1])


def test_positions_over_the_rigid_part():
    mesh = box_mesh(cavity=np.s_[1:3, 1:3, 1:2])
    positions = probe_positions(mesh)
    expected = [(x, 20.0, z) for z in (-10.0, 0.0) for x in (-10.0, 0.0, 10.0)]
    np.testing.assert_allclose(positions, expected)


def test_no_rigid_part():
    with pytest.raises(InputError, match="rigid parts"):
        probe_positions(box_mesh())


def test_skin_lies_under_the_papers_positions(shared_data):
    folder = shared_data / "patient1" / "paper"
    listed = np.loadtxt(folder / "probe_positions.txt")
    clearance = listed[:, 1] - skin_height(load_paper_mesh(folder), listed[:, [0, 2]])
    assert (clearance > -0.5).all()
    assert (clearance < 20.0).all()
