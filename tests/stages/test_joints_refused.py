"""Stores keep joints; stages that do not know them refuse them instead of leaving them out."""

from dataclasses import replace

import numpy as np
import pytest

from dataset.dataset_fakes import block
from mixpinn.base.errors import InputError
from mixpinn.dataset import SMALL, SimulationStore, Split
from mixpinn.fem import DEFAULT_TISSUE, Joint, JointFrame, LinearBushing, Scene
from mixpinn.pipeline import onboarding
from mixpinn.records import SampleTable
from mixpinn.stages.evaluation import EvaluationConfig, evaluate_models
from mixpinn.stages.hybrid import HybridStageConfig, make_hybrid
from mixpinn.stages.simulation import begin_simulations, settings_of, settings_of_scene

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def jointed(stiffness: float = 5.0) -> Scene:
    mesh = block(4)
    part = mesh.part.copy()
    inner = np.flatnonzero(part)
    part[inner[mesh.points[inner, 0] > 0.0]] = 2
    mesh = replace(mesh, part=part, rigid_names=("L2", "L1"))
    law = LinearBushing.of_diagonal([stiffness] * 6)
    frame = JointFrame("L2", "L1", (0.0, -15.0, 0.0), AXES)
    return Scene(mesh, materials=(DEFAULT_TISSUE,), joints=(Joint(frame, law),))


@pytest.fixture
def begun(tmp_path) -> tuple[Scene, SimulationStore]:
    scene = jointed()
    (tmp_path / "positions.txt").write_text("0 0 0\n")
    settings = replace(settings_of_scene(scene, SMALL), positions=str(tmp_path / "positions.txt"))
    return begin_simulations(scene.mesh, settings, out=tmp_path / "run", scene=scene)


def test_a_store_keeps_the_joints_and_other_joints_are_another_run(begun, tmp_path) -> None:
    scene, store = begun
    assert SimulationStore.open(store.folder).joints() == scene.joints
    other = jointed(6.0)
    settings = replace(settings_of_scene(other, SMALL), positions=str(tmp_path / "positions.txt"))
    with pytest.raises(InputError):
        begin_simulations(other.mesh, settings, out=tmp_path / "run", scene=other)


def test_stages_without_joints_refuse_them(begun, tmp_path) -> None:
    scene, store = begun
    empty, split = SampleTable.__new__(SampleTable), Split.__new__(Split)
    with pytest.raises(InputError, match=r"hybrid model.*does not know joints"):
        make_hybrid(store, empty, split, HybridStageConfig(), out=tmp_path / "hybrid")
    with pytest.raises(InputError, match=r"settings of a store.*does not know joints"):
        settings_of(store)
    with pytest.raises(InputError, match=r"elastic prior.*does not know joints"):
        onboarding._prior_bundle(scene, tmp_path / "bundle")
    with pytest.raises(InputError, match="prior=false"):
        evaluate_models(store, empty, split, [], EvaluationConfig(), out=tmp_path / "evaluation")
    assert not (tmp_path / "hybrid").exists()
