"""One flipped bit in what is read besides the stages' own results: samples, splits, joints, solves, budgets, counts."""

import numpy as np
import pytest

from drill.flip_drill import FEW, MANY, Artefact, flip_each
from drill.test_flips import predicted
from mixpinn.base.files import hash_arrays
from mixpinn.base.validated import load_record, save_record
from mixpinn.dataset import SimulationStore, Split, build_sample_table, dataset_table
from mixpinn.dataset.dataset_table import DatasetTable
from mixpinn.dataset.inverted_cells import InvertedCell, _Kept, _known
from mixpinn.dataset.summary import SUMMARY, GenerationSummary
from mixpinn.press.files import save_pose_model
from mixpinn.records import MESH_FILE, Evaluation, SampleTable
from mixpinn.records.error_budget import BUDGET_FILE, ErrorBudget
from mixpinn.records.joint_frame import JointFrame, load_joint_frames, save_joint_frames
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.serving.bundle_budget import keep_budget, load_budget
from mixpinn.stages.budget.make import make_budget
from mixpinn.stages.budget.solves import Found
from mixpinn.stages.budget.variants import BudgetConfig, Finer
from mixpinn.stages.hybrid import plain_pose_model, save_bundle
from mixpinn.stages.prior import cached_prior
from mixpinn.studies.ablation_sets import TestSet, _Sets
from mixpinn.studies.profile_measure import Timing, timing
from serving.live.pressed import block_predictor
from training.toy_block import block_mesh

CELL = InvertedCell("pose_000_000", 7, 2, 3, 4.0, 3.0, -0.1, ("L1",), 2, "soft tissue", 12.5, 0.3)
SETS = (TestSet("test", "positions never seen", 3, 6, 40), TestSet("deep", "deeper than ever seen", 3, 6, 11))


def compressed_bundle(chain, folder):
    """A bundle whose prior is kept in two factors."""
    store = SimulationStore.open(chain.simulation / "store")
    mesh, materials = store.mesh(), store.materials()
    model = HybridModel.of_prior(cached_prior(mesh, materials), Equilibrium.of_materials(mesh, materials))
    save_bundle(model, folder, tolerance=1e-3)
    save_pose_model(plain_pose_model(model, store.probe(), store.contact()), folder)
    return Artefact(folder, predicted, tuple(f"prior/{name}" for name in (
        "prior.json", "left.npy", "right.npy", "own.npy", "manifest.json",
    )))


def samples(chain, folder):
    table = build_sample_table(SimulationStore.open(chain.simulation / "store"))
    table.save(folder)

    def read(place):
        found = SampleTable.load(place)
        arrays = {name: value for name, value in vars(found).items() if isinstance(value, np.ndarray)}
        return found.mesh_hash, found.discretisation, hash_arrays(*(np.asarray(arrays[key]) for key in sorted(arrays)))

    return Artefact(folder, read, (
        "samples.json", "manifest.json", "displacement.npy", "contact_nodes.npy", "contact_offsets.npy",
        "contact_forces.npy", "depth.npy", "position_index.npy", "probe_rotation.npy", "probe_wrench.npy",
    ))


def records(chain, folder):
    """Small files, one a kind."""
    table = build_sample_table(SimulationStore.open(chain.simulation / "store"))
    split = Split("positions-42", np.array([0, 1, 2]), np.array([3]), np.array([4, 5]))
    split.save(folder / "split.json")
    dataset_table(table, split).save(folder / "counts.json")
    save_joint_frames(
        [JointFrame.of_arrays("L5", "L4", origin=np.array([1.0, 2.5, -3.0]), axes=np.eye(3), spacing=34.5)],
        folder / "joints.json",
    )
    save_record(folder / "inverted.json", {"pose_000_000": _Kept("0123abcd", (CELL,))})
    save_record(folder / "sets.json", _Sets(SETS))
    values = np.array([0.125, 0.25])
    Evaluation(
        "prior", "test", {"mee": values}, {"depth": values}, {"L1": values}, values, {"weights": "0a1b"},
    ).save(folder / "evaluation.json")
    save_record(folder / "timing.json", timing(
        values, values, mesh=("block", block_mesh()), method="fem", device="cpu", threads=1, peak_mb=None,
    ))
    (folder / SUMMARY).write_bytes((chain.simulation / SUMMARY).read_bytes())
    readers = {
        "split.json": lambda path: {name: part.tolist() for name, part in Split.load(path).parts.items()},
        "counts.json": DatasetTable.load, "joints.json": load_joint_frames,
        "sets.json": lambda path: load_record(_Sets, path, remake="-"),
        "evaluation.json": lambda path: str(vars(Evaluation.load(path))),
        "timing.json": lambda path: load_record(Timing, path, remake="-"), SUMMARY: GenerationSummary.load,
    }

    def read(place):
        # What is known of inverted cells is sought again where it is damaged.
        known = _known(place / "inverted.json") or {"pose_000_000": _Kept("0123abcd", (CELL,))}
        return known, [reader(place / name) for name, reader in readers.items()]

    return Artefact(folder, read, (*readers, "inverted.json"))


def budget(chain, folder):
    """A budget with its solves, and a bundle that carries it."""
    predictor, bundle = block_predictor(), folder / "bundle"
    predictor.mesh.save(bundle / MESH_FILE)
    predictor.model.save(bundle)
    save_pose_model(predictor.pose, bundle)
    config = BudgetConfig(poses=1, depth=1.0, finer=Finer.QUADRATIC)
    keep_budget(make_budget(bundle, config, out=folder / "run"), bundle)

    def read(place):
        solve = vars(Found.load(sorted((place / "run" / "solves").glob("*.npz"))[0])).values()
        budgets = ErrorBudget.load(place / "run" / BUDGET_FILE), load_budget(place / "bundle", predictor.mesh)
        return budgets, hash_arrays(*[np.asarray(value) for value in solve])

    return Artefact(folder, read, (
        f"run/{BUDGET_FILE}", "run/solves/*.npz", f"bundle/{BUDGET_FILE}", "bundle/manifest.json",
    ))


@pytest.mark.parametrize("make", [compressed_bundle, samples, records, budget])
def test_any_bit(chain, tmp_path, make, drill):
    (tmp_path / "made").mkdir()
    many = MANY if drill else FEW
    print(f"{make.__name__}: refused of {many} flips: {flip_each(make(chain, tmp_path / 'made'), many=many)}")
