"""What was noticed about an anatomy reaches whoever predicts with it, once and in short."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from anatomy.builders import masks, write_folder
from mixpinn.networks.checkpoint import NETWORK
from mixpinn.records import MESH_FILE, LabelMap, TissueMesh
from pipeline.chain import command, done


@pytest.fixture
def doubted(chain, tmp_path):
    """The chain's network, of an anatomy that was taken with doubts."""
    folder = tmp_path / "model"
    shutil.copytree(chain.model, folder)
    mesh = replace(TissueMesh.load(folder / MESH_FILE), doubts=(
        "vertebrae_L1: cut off: 12 voxels at the image's border", "repaired: vertebrae_L2: order: swapped",
    ))
    mesh.save(folder / MESH_FILE)
    NETWORK.seal_more(folder, [MESH_FILE])
    return folder


def contacts(chain, folder):
    mesh = TissueMesh.load(chain.mesh / MESH_FILE)
    free = np.unique(mesh.skin_faces)
    node = int(free[mesh.points[free, 1].argmax()])
    path = folder / "contacts.csv"
    path.write_text(f"node,dx,dy,dz\n{node},0,-1,0\n")
    return path


def test_predict_says_them_once_in_short(chain, doubted, tmp_path):
    words = ["--contacts", contacts(chain, tmp_path), "--out", tmp_path / "out.vtu"]
    said = [line for line in done("predict", doubted, *words).lines if "doubts" in line]
    assert said == [
        "Warning: anatomy, mesh or probe were taken with doubts: cut off (vertebrae_L1); repaired (vertebrae_L2)"
    ]
    assert not any("doubts" in line for line in done("predict", chain.model, *words).lines)


def test_anatomy_keeps_them_in_the_label_map(tmp_path):
    structures = masks()
    structures["vertebrae_L1"][5, 5, 12] = False
    write_folder(tmp_path / "in", structures, np.diag([10.0, 10.0, 10.0, 1.0]))
    done("anatomy", tmp_path / "in", "--out", tmp_path / "out")
    found = json.loads((tmp_path / "out" / "findings.json").read_text())
    label_map = LabelMap.load(tmp_path / "out" / "labels.nii.gz")
    assert found
    assert label_map.doubts == tuple(f"{f['structure']}: {f['kind']}: {f['detail']}" for f in found)


@pytest.mark.parametrize("what", ["folder", "file"])
def test_mesh_of_unchecked_images_names_the_verb_that_comes_first(tmp_path, what):
    source = write_folder(tmp_path / "in")
    source = source if what == "folder" else source / "body_trunc.nii.gz"
    outcome = command("mesh", source, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert len(outcome.lines) == 1
    assert f"mixpinn anatomy {source} --out" in outcome.lines[0]
    assert not (tmp_path / "out").exists()


def test_a_built_body_is_not_cut_off(chain):
    assert LabelMap.load(chain.anatomy / "labels.nii.gz").doubts == ()
