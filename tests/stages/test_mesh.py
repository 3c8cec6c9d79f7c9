from dataclasses import replace

import numpy as np
import pytest

from mesh.shapes import box_mesh
from mixpinn.anatomy import crop, place_in_frame, read_folder, tiny_phantom
from mixpinn.base.errors import InputError
from mixpinn.mesh import extract_surfaces, has_cgal
from mixpinn.stages.mesh import PAPER_CELLS, MeshConfig, MeshResult, make_mesh


@pytest.fixture(scope="module")
def phantom():
    return tiny_phantom()


def test_run_directory_of_the_tiny_phantom(phantom, tmp_path):
    config = MeshConfig(size=2.0)
    result = make_mesh(phantom, config, out=tmp_path / "mesh")
    written = {path.name for path in (tmp_path / "mesh").iterdir()}
    assert {"mesh.vtu", "statistics.json", "statistics.md", "quality.json", "fidelity.json", "run.json"} <= written
    assert (tmp_path / "mesh" / "mesh.png").stat().st_size > 10_000
    assert 600 <= result.mesh.n_points <= 2000
    assert result.quality.inverted == 0
    assert result.quality.min_dihedral >= 5.0
    assert result.fidelity.structures[0].dice >= 0.97
    assert result.mesh.fixed.any()
    loaded = MeshResult.load(tmp_path / "mesh")
    assert loaded.mesh.hash() == result.mesh.hash()
    assert (loaded.statistics, loaded.quality, loaded.fidelity) == (result.statistics, result.quality, result.fidelity)
    before = (tmp_path / "mesh" / "mesh.vtu").stat().st_mtime_ns
    make_mesh(phantom, config, out=tmp_path / "mesh")
    assert (tmp_path / "mesh" / "mesh.vtu").stat().st_mtime_ns == before
    with pytest.raises(InputError, match="another config"):
        make_mesh(phantom, MeshConfig(size=3.0), out=tmp_path / "mesh")


def test_one_geometry_at_every_size(phantom):
    """Cells are finer, facets, rigid parts' volumes and the extent of the fixed skin are the same."""
    coarse, fine = (make_mesh(phantom, MeshConfig(size=size, facets=3.0, picture=False)) for size in (3.0, 1.8))
    assert fine.mesh.n_points > 1.5 * coarse.mesh.n_points
    assert fine.quality.inverted == 0
    assert fine.quality.min_dihedral >= 5.0
    np.testing.assert_array_equal(fine.mesh.points[: coarse.mesh.n_points], coarse.mesh.points)

    def measures(mesh):
        faces = mesh.boundary_faces
        a, b, c = np.moveaxis(mesh.points[faces], 1, 0)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        of_part = [area[(mesh.part[faces] == k).all(axis=1)].sum() for k in range(mesh.n_parts + 1)]
        held = area[mesh.fixed[faces].all(axis=1)].sum()
        return [mesh.cell_volumes.sum(), area.sum(), held, *of_part]

    np.testing.assert_allclose(measures(fine.mesh), measures(coarse.mesh), rtol=1e-9)


@pytest.mark.skipif(not has_cgal(), reason="the bars are those of CGAL's mesher")
def test_graded_cells_are_fine_where_the_probe_presses(phantom):
    mesh = make_mesh(phantom, MeshConfig(size=1.5, picture=False)).mesh
    corners = mesh.points[mesh.skin_faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
    centre, normal = corners.mean(axis=1), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    back = normal[:, 1] > 0.7 * np.linalg.norm(normal, axis=1)
    over = np.abs(centre[:, [0, 2]] - mesh.points[mesh.part > 0].mean(axis=0)[[0, 2]]).max(axis=1) < 25.0
    front = normal[:, 1] < -0.7 * np.linalg.norm(normal, axis=1)
    assert np.median(edges[back & over]) == pytest.approx(1.5 * 8.0, rel=0.3)
    assert np.median(edges[front]) > 1.3 * np.median(edges[back & over])


def test_facets_finer_than_cells_are_refused():
    with pytest.raises(InputError, match="larger facets"):
        MeshConfig(size=2.0, facets=1.0)
    with pytest.raises(InputError, match="graded cells"):
        MeshConfig(cells="uniform", facets=1.0)


def test_import_as_a_stage(tmp_path):
    mesh = box_mesh(cavity=np.s_[1:3, 1:3, 1:2])
    mesh.save(tmp_path / "box.vtu")
    result = make_mesh(tmp_path / "box.vtu", MeshConfig(picture=False), out=tmp_path / "run")
    assert result.fidelity is None
    assert not (tmp_path / "run" / "mesh.png").exists()
    assert MeshResult.load(tmp_path / "run").fidelity is None


def test_quadratic_elements_are_a_choice(tmp_path):
    box_mesh(cavity=np.s_[1:3, 1:3, 1:2]).save(tmp_path / "box.vtu")
    made = make_mesh(tmp_path / "box.vtu", MeshConfig(element="quadratic"), out=tmp_path / "run").mesh
    again = MeshResult.load(tmp_path / "run").mesh
    assert made.order == again.order == 2
    assert made.hash() == again.hash()
    assert made.n_nodes == made.n_points + len(made.edges)
    linear = make_mesh(tmp_path / "box.vtu", MeshConfig(picture=False)).mesh
    assert linear.hash() == made.with_order(1).hash() != made.hash()


def test_bad_input_leaves_no_folder(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        make_mesh(tmp_path / "absent.vtu", out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_handed_in_surfaces_are_checked(phantom):
    surfaces = extract_surfaces(phantom)
    body = surfaces.body
    with pytest.raises(InputError, match="border edges"):
        make_mesh(replace(surfaces, body=replace(body, triangles=body.triangles[1:])))


@pytest.mark.skipif(not has_cgal(), reason="the bars are those of CGAL's mesher")
def test_patient(shared_data, drill):
    """The bars of the paper's mesh table, on the real anatomy."""
    if not drill:
        pytest.skip("only in 'make drill': half a minute of meshing")
    label_map = place_in_frame(crop(read_folder(shared_data / "patient1")))
    result = make_mesh(label_map, PAPER_CELLS)
    points = np.array([part.points for part in result.statistics.parts])
    paper = np.array([5533, 516, 676, 655, 702, 664])
    assert points.sum() == pytest.approx(8746, rel=0.1)
    assert (np.abs(points - paper) <= 0.2 * paper).all()
    assert result.quality.inverted == 0
    assert result.quality.bridging_faces == 0
    assert result.quality.min_dihedral >= 5.0
    assert result.fidelity.structures[0].dice >= 0.97
    assert min(structure.dice for structure in result.fidelity.structures[1:]) >= 0.9
