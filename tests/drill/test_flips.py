"""One flipped bit, wherever it lies in an artefact's files: refused in one line, or the same answer as without it."""

import shutil

import numpy as np
import pytest

from drill.flip_drill import FEW, MANY, Artefact, flip_each
from mixpinn.base.config import build_config
from mixpinn.base.files import hash_arrays
from mixpinn.dataset import SimulationStore
from mixpinn.records import LabelMap
from mixpinn.reduced.compliance import cluster_files
from mixpinn.serving import load_predictor
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy
from mixpinn.stages.mesh import MeshConfig, MeshResult, make_mesh
from mixpinn.stages.prior import cached_prior
from mixpinn.training import read_history
from pipeline.chain import ANATOMY, MESH
from stages.test_seal import bundle  # noqa: F401 (a fixture)

KINDS = ("bundle", "network", "losses", "labels", "anatomy", "mesh", "mesh run", "store", "simulation", "cache")


def predicted(folder):
    """What a bundle or a network answers: to contact displacements, and to a pose where it takes one."""
    predictor = load_predictor(folder, threads=1, warm_up=False)
    nodes = np.flatnonzero((predictor.mesh.part == 0) & ~predictor.mesh.fixed)
    skin = np.intersect1d(np.unique(predictor.mesh.skin_faces), nodes)
    held = skin[np.argsort(predictor.mesh.points[skin, 1])[-4:]]
    held.sort()
    answers = [predictor.predict_at(held, np.tile([0.0, -1.5, 0.2], (4, 1)))]
    if (folder / "hybrid.json").is_file():
        x, y, z = predictor.mesh.points[held[0]]
        answers.append(predictor.press((x, y - 1.0, z)))
    return [
        (answer.model, hash_arrays(np.asarray(answer.displacement)), answer.describe(), answer.warnings())
        for answer in answers
    ]


def labels_of(folder):
    label_map = LabelMap.load(folder / "labels.nii.gz")
    return label_map.hash(), label_map.names, label_map.world_to_scanner.tolist()


def anatomy_of(folder):
    """The stage again, which takes over what lies there."""
    result = make_anatomy(build_config(AnatomyConfig, ANATOMY), out=folder)
    return result.label_map.hash(), result.label_map.names, [str(finding) for finding in result.findings]


def losses_of(folder):
    return str(read_history(folder))


def mesh_of(folder):
    result = MeshResult.load(folder)
    measured = str((result.statistics, result.quality, result.fidelity))
    return result.mesh.hash(), result.mesh.rigid_names, result.mesh.doubts, measured


def scene_of(folder):
    """What the verbs that follow take from a store besides its simulations."""
    store = SimulationStore.open(folder)
    probe = store.probe()
    return (
        store.identity, store.mesh().hash(), probe and probe.hash(), store.materials(), store.contact(),
        [pose.name for pose in store.poses], store.positions.tolist(), store.discretisation,
    )


def pose_of(folder):
    """What they take from one pose of it."""
    store = SimulationStore.open(folder)
    status, simulation = store.status(store.poses[0]), store.load(store.poses[0])
    arrays = simulation.arrays()
    return str(status), hash_arrays(*(arrays[name] for name in sorted(arrays))), str(vars(simulation)["rotation_deg"])


@pytest.fixture
def artefact(chain, bundle, tmp_path, monkeypatch):  # noqa: F811
    """Maker of a copy of an artefact."""
    store = SimulationStore.open(chain.simulation / "store")
    mesh, materials = store.mesh(), store.materials()
    labels = LabelMap.load(chain.anatomy / "labels.nii.gz")
    name = store.poses[0].name

    def prior_of(folder):
        monkeypatch.setenv("MIXPINN_CACHE", str(folder))
        prior = cached_prior(mesh, materials)
        return hash_arrays(np.asarray(prior.compliance.matrix), prior.nodes), prior.name, prior.missed

    kinds = {
        "bundle": Artefact(bundle, predicted, (
            "hybrid.json", "hybrid.safetensors", "pose.safetensors", "mesh.vtu", "manifest.json", "prior/prior.json",
            *(f"prior/{name}.npy" for name in cluster_files.SPECS), "prior/manifest.json",
        )),
        "network": Artefact(chain.model, predicted, ("model.json", "weights.safetensors", "mesh.vtu", "manifest.json")),
        "losses": Artefact(chain.model, losses_of, ("history.csv", "manifest.json")),
        "labels": Artefact(chain.anatomy, labels_of, ("labels.nii.gz", "labels.json", "labels.manifest.json")),
        "anatomy": Artefact(chain.anatomy, anatomy_of, ("findings.json", "run.json", "labels.json")),
        "mesh": Artefact(chain.mesh, mesh_of, (
            "mesh.vtu", "statistics.json", "quality.json", "fidelity.json", "manifest.json",
        )),
        "mesh run": Artefact(
            chain.mesh, lambda folder: str(make_mesh(labels, build_config(MeshConfig, MESH), out=folder).quality),
            ("run.json",),
        ),
        "store": Artefact(chain.simulation / "store", scene_of, (
            "store.json", "mesh.vtu", "probe.stl", "manifest.json",
        )),
        "simulation": Artefact(chain.simulation / "store", pose_of, (
            f"status/{name}.json", f"{name}/zarr.json", f"{name}/displacement/zarr.json",
            f"{name}/displacement/c/*/0/0", f"{name}/contact_nodes/c/0", f"{name}/contact_offsets/c/0",
            f"{name}/probe_wrench/c/0/0", f"{name}/converged/c/0",
        )),
        "cache": Artefact(tmp_path / "cache", prior_of, (
            "prior/*/prior.json", "prior/*/compliance.npy", "prior/*/manifest.json",
        )),
    }
    kinds["cache"].folder.mkdir()

    def copied(kind):
        chosen = kinds[kind]
        if kind == "cache":
            prior_of(chosen.folder)
        shutil.copytree(chosen.folder, tmp_path / "copy")
        return Artefact(tmp_path / "copy", chosen.answer, chosen.files)

    return copied


@pytest.mark.parametrize("kind", KINDS)
def test_any_bit(artefact, kind, drill):
    many = MANY if drill else FEW
    print(f"{kind}: refused of {many} flips: {flip_each(artefact(kind), many=many)}")
