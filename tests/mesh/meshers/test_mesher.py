from dataclasses import replace

import numpy as np
import pytest

from mesh.shapes import ball_label_map
from mixpinn.base.errors import InputError
from mixpinn.mesh import (
    CgalMesher,
    DomainSurfaces,
    Sizing,
    Surface,
    TetwildMesher,
    check_cells,
    extract_surfaces,
    has_cgal,
    label_mesh,
    mesh_quality,
)
from mixpinn.mesh.meshers.cgal_mesher import spread_points
from mixpinn.mesh.meshers.mesher import tidy
from mixpinn.mesh.meshers.tetwild_mesher import decimated
from mixpinn.stages.mesh import MeshConfig, make_mesh, make_mesher

MESHERS = [
    pytest.param(CgalMesher(), id="cgal", marks=pytest.mark.skipif(not has_cgal(), reason="no CGAL bindings")),
    pytest.param(TetwildMesher(), id="tetwild"),
]
LABEL_MAP = ball_label_map(voxel=3.0, centres=((-16.0, 0.0, 0.0), (16.0, 0.0, 0.0)))


@pytest.mark.parametrize("mesher", MESHERS)
def test_ball_with_two_cavities(mesher):
    surfaces = extract_surfaces(LABEL_MAP)
    points, cells = mesher.fill(surfaces, Sizing().scaled(3.0))
    check_cells(points, cells, what="ball")
    mesh = label_mesh(points, cells, surfaces, label_map=LABEL_MAP)
    quality = mesh_quality(mesh)
    assert quality.min_dihedral >= 5.0
    assert quality.bridging_faces == 0
    wanted = surfaces.body.volume - sum(rigid.volume for rigid in surfaces.rigid)
    assert mesh.cell_volumes.sum() == pytest.approx(wanted, rel=0.1)
    assert all(len(mesh.part_nodes(k)) > 10 for k in (1, 2))


@pytest.mark.skipif(not has_cgal(), reason="no CGAL bindings")
def test_cgal_gives_the_same_mesh_twice():
    surfaces = extract_surfaces(LABEL_MAP)
    first, second = (CgalMesher().fill(surfaces, Sizing().scaled(3.0)) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


@pytest.mark.skipif(not has_cgal(), reason="no CGAL bindings")
def test_cgal_refuses_open_surfaces():
    body = extract_surfaces(replace(LABEL_MAP, rigid_names=())).body
    holed = Surface("body", body.points, body.triangles[5:])
    with pytest.raises(InputError, match="open or branching"):
        CgalMesher().fill(DomainSurfaces(holed, ()), Sizing())


def test_sizes_scale_lengths_only():
    scaled = Sizing().scaled(2.0)
    assert (scaled.cell_size, scaled.facet_size, scaled.facet_approximation) == (80.0, 60.0, 2.0)
    assert (scaled.cell_ratio, scaled.facet_angle) == (2.0, 30.0)
    with pytest.raises(InputError, match="positive factor"):
        Sizing().scaled(0.0)


def test_larger_size_gives_fewer_points():
    fine, coarse = (make_mesh(LABEL_MAP, MeshConfig(size=size, picture=False)).mesh.n_points for size in (1.5, 3.0))
    assert coarse < fine


def test_tidy_keeps_the_largest_piece_and_drops_loose_points():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [7, 7, 7], [5, 0, 0], [6, 0, 0],
                       [5, 1, 0], [5, 0, 1]])
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [6, 7, 8, 9]])
    kept, oriented = tidy(points, cells, what="pieces")
    np.testing.assert_array_equal(kept, points[:5])
    check_cells(kept, oriented, what="pieces")
    with pytest.raises(InputError, match="no tetrahedra"):
        tidy(points, cells[:0], what="nothing")


def test_spread_points_are_far_apart():
    points = np.random.default_rng(0).normal(size=(500, 3))
    chosen = spread_points(points, 8)
    distance = np.linalg.norm(chosen[:, None] - chosen[None], axis=-1) + 1e9 * np.eye(8)
    cover = np.linalg.norm(points[:, None] - chosen[None], axis=-1).min(axis=1).max()
    assert distance.min() >= cover


def test_decimation_keeps_the_volume():
    body = extract_surfaces(LABEL_MAP).body
    coarse = decimated(body, 60.0)
    assert len(coarse.triangles) < 0.5 * len(body.triangles)
    assert coarse.volume == pytest.approx(body.volume, rel=0.02)
    assert decimated(body, 1e-3) is body


def test_named_meshers():
    assert make_mesher("tetwild").name == "tetwild"
    assert make_mesher("auto").name == ("cgal" if has_cgal() else "tetwild")
