import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mesh.shapes import box_mesh
from mixpinn.base.errors import InputError
from mixpinn.mesh import check_cells, orient_cells
from mixpinn.records.tetrahedra import signed_volumes

UNIT = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def test_volume_of_the_unit_tetrahedron_is_a_sixth():
    assert signed_volumes(UNIT, np.array([[0, 1, 2, 3], [1, 0, 2, 3]])) == pytest.approx([1 / 6, -1 / 6])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_order_of_nodes_is_oriented_positively_and_fits_together(seed):
    mesh, rng = box_mesh((2, 2, 2)), np.random.default_rng(seed)
    shuffled = rng.permuted(mesh.cells, axis=1)
    cells = orient_cells(mesh.points, shuffled)
    assert (signed_volumes(mesh.points, cells) > 0).all()
    np.testing.assert_array_equal(np.sort(cells, axis=1), np.sort(mesh.cells, axis=1))
    check_cells(mesh.points, cells, what="box")


def test_flat_cells_are_refused():
    points = np.vstack([UNIT, [[0.3, 0.3, 0.0]]])
    with pytest.raises(InputError, match="zero volume"):
        check_cells(points, np.array([[0, 1, 2, 3], [0, 1, 2, 4]]), what="flat")


def test_a_node_pulled_through_its_neighbours_is_found_after_orientation():
    mesh = box_mesh((2, 2, 2))
    points = mesh.points.copy()
    points[np.abs(points).sum(axis=1).argmin()] += [25.0, 0.0, 0.0]
    with pytest.raises(InputError, match="one side"):
        check_cells(points, orient_cells(points, mesh.cells), what="folded")


def test_duplicate_cells_are_refused():
    with pytest.raises(InputError, match="shared by more"):
        check_cells(UNIT, np.array([[0, 1, 2, 3]] * 3), what="twice")
