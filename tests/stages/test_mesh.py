from dataclasses import replace

import numpy as np
import pytest

from mesh.shapes import box_mesh
from mixpinn.anatomy import crop, place_in_frame, read_folder, tiny_phantom
from mixpinn.base.errors import InputError
from mixpinn.mesh import extract_surfaces, has_cgal
from mixpinn.stages.mesh import MeshConfig, MeshResult, make_mesh


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


def test_import_as_a_stage(tmp_path):
    mesh = box_mesh(cavity=np.s_[1:3, 1:3, 1:2])
    mesh.save(tmp_path / "box.vtu")
    result = make_mesh(tmp_path / "box.vtu", MeshConfig(picture=False), out=tmp_path / "run")
    assert result.fidelity is None
    assert not (tmp_path / "run" / "mesh.png").exists()
    assert MeshResult.load(tmp_path / "run").fidelity is None


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
def test_patient(shared_data):
    """The bars of the paper's mesh table, on the real anatomy."""
    label_map = place_in_frame(crop(read_folder(shared_data / "patient1")))
    result = make_mesh(label_map)
    points = np.array([part.points for part in result.statistics.parts])
    paper = np.array([5533, 516, 676, 655, 702, 664])
    assert points.sum() == pytest.approx(8746, rel=0.1)
    assert (np.abs(points - paper) <= 0.2 * paper).all()
    assert result.quality.inverted == 0
    assert result.quality.bridging_faces == 0
    assert result.quality.min_dihedral >= 5.0
    assert result.fidelity.structures[0].dice >= 0.97
    assert min(structure.dice for structure in result.fidelity.structures[1:]) >= 0.9
