from dataclasses import replace

import numpy as np
import pytest

from mesh.shapes import box_mesh
from mixpinn.mesh import FixedRegion, fixed_nodes, label_mesh, part_contacts
from mixpinn.mesh.surfaces.surface import DomainSurfaces, Surface

CAVITY = np.s_[1:3, 1:3, 1:2]


def boundary(mesh, k, name):
    faces = mesh.boundary_faces
    return Surface(name, mesh.points, faces[(mesh.part[faces] == k).all(axis=1)])


def test_nodes_of_a_cavity_belong_to_its_part():
    mesh = box_mesh(cavity=CAVITY)
    surfaces = DomainSurfaces(boundary(mesh, 0, "body"), (boundary(mesh, 1, "block").reversed(),))
    labelled = label_mesh(mesh.points, mesh.cells, surfaces)
    np.testing.assert_array_equal(labelled.part, mesh.part)
    assert labelled.rigid_names == ("block",)


def test_fixed_nodes_of_a_box():
    """A box of 40 × 80 × 40 mm: fixed are the nodes at y = −40 … −20 on the skin, without those on the two z faces."""
    mesh = box_mesh((4, 8, 4))
    x, y, z = mesh.points.T
    expected = (y < -10.0) & (np.abs(z) < 20.0) & ((np.abs(x) == 20.0) | (y == -40.0))
    np.testing.assert_array_equal(fixed_nodes(mesh), expected)


def test_fixed_region_is_the_surfaces_not_the_meshs():
    """The same body meshed with a corner cut off: the mesh's most anterior node moves, the region does not."""
    mesh = box_mesh((4, 8, 4))
    whole = FixedRegion.of(mesh.points)
    assert (whole.behind, whole.low, whole.high) == (-10.0, -19.0, 19.0)
    kept = mesh.points[mesh.cells][:, :, 1].min(axis=1) >= -30.0
    used, cells = np.unique(mesh.cells[kept], return_inverse=True)
    cut = replace(
        mesh, points=mesh.points[used], cells=cells.reshape(-1, 4).astype(np.int32), part=mesh.part[used],
        fixed=mesh.fixed[used], tissue=mesh.tissue[kept],
    )
    assert cut.points[fixed_nodes(cut, region=whole), 1].max() == -20.0
    assert cut.points[fixed_nodes(cut), 1].max() == -10.0


def test_contacts_counted_on_two_cells():
    """Cells 0123 and 1234: nodes 0–3 on part 1 make the first rigid, node 4 on part 2 makes the second span."""
    mesh = box_mesh((1, 1, 1))
    mesh = replace(
        mesh, points=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]),
        cells=np.array([[0, 1, 2, 3], [1, 2, 3, 4]], dtype=np.int32), part=np.array([1, 1, 1, 1, 2]),
        rigid_names=("a", "b"),
    )
    contacts = part_contacts(mesh)
    assert (contacts.rigid_cells, contacts.spanning_cells, contacts.bridging_faces) == (1, 1, 3)


def test_label_needs_nodes_of_every_part():
    mesh = box_mesh()
    far = Surface("far", mesh.points[:4] + 1000.0, np.array([[0, 1, 2], [0, 2, 3]]))
    with pytest.raises(Exception, match=r"far.*without a mesh node"):
        label_mesh(mesh.points, mesh.cells, DomainSurfaces(boundary(mesh, 0, "body"), (far,)))
