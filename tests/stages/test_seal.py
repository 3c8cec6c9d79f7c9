"""A flipped bit in any file of an artefact is noticed when the artefact is read."""

import shutil

import numpy as np
import pytest

from base.test_manifest import flip
from mixpinn.base.errors import InputError
from mixpinn.dataset import SimulationStore
from mixpinn.press.files import save_pose_model
from mixpinn.records import LabelMap
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.serving import load_predictor
from mixpinn.stages.hybrid import plain_pose_model, save_bundle
from mixpinn.stages.mesh import MeshResult, load_mesh
from mixpinn.stages.prior import cached_prior
from mixpinn.stages.seal import seal_folder


@pytest.fixture(scope="module")
def bundle(chain, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sealed") / "bundle"
    store = SimulationStore.open(chain.simulation / "store")
    mesh, materials = store.mesh(), store.materials()
    model = HybridModel.of_prior(cached_prior(mesh, materials), Equilibrium.of_materials(mesh, materials))
    save_bundle(model, folder)
    save_pose_model(plain_pose_model(model, store.probe(), store.contact()), folder)
    return folder


def read_store(folder):
    store = SimulationStore.open(folder)
    return store.mesh(), store.probe()


READERS = {
    "bundle": (load_predictor, (
        "hybrid.json", "hybrid.safetensors", "pose.safetensors", "mesh.vtu", "prior/prior.json",
        "prior/near.npy", "prior/near_scale.npy", "prior/far.npy", "prior/exact.npy", "prior/manifest.json",
    )),
    "model": (load_predictor, ("model.json", "weights.safetensors", "mesh.vtu")),
    "anatomy": (lambda folder: LabelMap.load(folder / "labels.nii.gz"), ("labels.nii.gz", "labels.json")),
    "mesh": (MeshResult.load, ("mesh.vtu", "statistics.json", "quality.json")),
    "store": (read_store, ("store.json", "mesh.vtu", "probe.stl")),
}


@pytest.fixture
def copied(chain, bundle, tmp_path):
    """Copy an artefact of a kind and say what reads it."""
    folders = {
        "bundle": bundle, "model": chain.model, "anatomy": chain.anatomy, "mesh": chain.mesh,
        "store": chain.simulation / "store",
    }

    def copy(kind):
        shutil.copytree(folders[kind], tmp_path / kind)
        return tmp_path / kind, READERS[kind][0]

    return copy


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, (_, names) in READERS.items() for name in names])
def test_a_flipped_bit_is_noticed(copied, kind, name):
    folder, read = copied(kind)
    read(folder)
    size = (folder / name).stat().st_size
    for place in (size // 3, size - 2):
        flip(folder / name, place)
        with pytest.raises(InputError) as caught:
            read(folder)
        assert name in str(caught.value)
        assert "\n" not in str(caught.value)
        flip(folder / name, place)
    read(folder)


@pytest.mark.parametrize("kind", READERS)
def test_what_has_no_manifest_is_refused_until_its_owner_vouches_for_it(copied, kind):
    folder, read = copied(kind)
    assert seal_folder(folder) == []
    manifests = list(folder.rglob("*manifest.json"))
    for path in manifests:
        path.unlink()
    with pytest.raises(InputError, match="mixpinn seal"):
        read(folder)
    seal_folder(folder)
    read(folder)
    assert sorted(folder.rglob("*manifest.json")) == sorted(manifests)


def test_mesh_alone_needs_no_manifest_but_its_folder_does(copied):
    folder, _ = copied("mesh")
    assert load_mesh(folder / "mesh.vtu").hash() == load_mesh(folder).hash()
    (folder / "manifest.json").unlink()
    load_mesh(folder / "mesh.vtu")
    with pytest.raises(InputError, match="mixpinn seal"):
        load_mesh(folder)


def test_a_damaged_entry_of_the_cache_is_made_anew(chain, tmp_path, monkeypatch):
    monkeypatch.setenv("MIXPINN_CACHE", str(tmp_path))
    store = SimulationStore.open(chain.simulation / "store")
    first = np.array(cached_prior(store.mesh(), store.materials()).compliance.matrix)
    (path,) = tmp_path.rglob("compliance.npy")
    flip(path, path.stat().st_size - 2)
    assert not np.array_equal(np.load(path), first)
    np.testing.assert_array_equal(cached_prior(store.mesh(), store.materials()).compliance.matrix, first)
    np.testing.assert_array_equal(np.load(path), first)


def test_a_folder_of_something_else_is_refused(tmp_path):
    with pytest.raises(InputError, match="none of them"):
        seal_folder(tmp_path)
