"""Joints through the stages: in stores, in the prior and its bundle."""

from dataclasses import replace

import numpy as np
import pytest

from dataset.dataset_fakes import block
from mixpinn.base.errors import InputError
from mixpinn.dataset import SMALL, SimulationStore
from mixpinn.fem import DEFAULT_TISSUE, Joint, JointFrame, LinearBushing, Scene
from mixpinn.pipeline import onboarding
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.serving import load_predictor
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


def test_settings_of_joints_that_are_no_settings_are_refused(begun) -> None:
    with pytest.raises(InputError, match=r"settings of a store.*joints of your own"):
        settings_of(begun[1])


def test_the_prior_bundle_knows_the_joints(begun, tmp_path) -> None:
    scene, _ = begun
    model = onboarding._prior_bundle(scene, tmp_path / "bundle")
    assert model.prior.restraints == scene.restraints
    again = HybridModel.load(tmp_path / "bundle", scene.mesh)
    assert again.newton.equilibrium.restraints == scene.restraints
    bare = onboarding._prior_bundle(replace(scene, joints=()), tmp_path / "bare")
    assert np.abs(again.prior.own_compliance - bare.prior.own_compliance).max() > 1e-3 * bare.prior.own_compliance.max()


@pytest.mark.parametrize("absent", ["manifest.json", "pose.safetensors", "prior/manifest.json"])
def test_a_prior_bundle_that_was_being_written_is_written_again(begun, tmp_path, absent) -> None:
    scene, _ = begun
    onboarding._prior_bundle(scene, tmp_path / "bundle")
    (tmp_path / "bundle" / absent).unlink()
    onboarding._prior_bundle(scene, tmp_path / "bundle")
    assert load_predictor(tmp_path / "bundle", warm_up=False).pose is not None
    kept = (tmp_path / "bundle" / "hybrid.json").stat().st_mtime_ns
    onboarding._prior_bundle(scene, tmp_path / "bundle")
    assert (tmp_path / "bundle" / "hybrid.json").stat().st_mtime_ns == kept
