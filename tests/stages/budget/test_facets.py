"""Finer facets of an anatomy, and a mesh that is taken as it is."""

from dataclasses import replace

import pytest

from mixpinn.anatomy.phantom import tiny_phantom
from mixpinn.base.errors import InputError
from mixpinn.mesh.meshers.grading import Grading
from mixpinn.stages.anatomy import LABELS_FILE
from mixpinn.stages.budget import facets
from mixpinn.stages.budget.facets import finer_facets
from mixpinn.stages.mesh import MeshConfig, make_mesh


@pytest.fixture(scope="module")
def anatomy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("anatomy")
    tiny_phantom().save(folder / LABELS_FILE)
    return folder


def test_a_label_map_is_meshed_with_facets_closer_to_its_surface(anatomy, tmp_path, monkeypatch):
    asked = []
    small = make_mesh(tiny_phantom(), MeshConfig(size=3.0, picture=False))
    monkeypatch.setattr(facets, "make_mesh", lambda source, config, out: asked.append((config, out)) or small)
    assert finer_facets(anatomy, out=tmp_path / "facets") is small.mesh
    (config, out), = asked
    assert out == tmp_path / "facets"
    assert config.grading == replace(Grading(), distance=0.5 * Grading().distance)


def test_a_mesh_is_taken_as_it_is(anatomy, tmp_path):
    made = make_mesh(tiny_phantom(), MeshConfig(size=3.0, picture=False), out=tmp_path / "mesh").mesh
    assert finer_facets(tmp_path / "mesh", out=tmp_path / "unused").hash() == made.hash()
    assert finer_facets(tmp_path / "mesh" / "mesh.vtu", out=tmp_path / "unused").hash() == made.hash()
    assert not (tmp_path / "unused").exists()


def test_another_folder_is_refused(tmp_path):
    with pytest.raises(InputError):
        finer_facets(tmp_path, out=tmp_path / "facets")
