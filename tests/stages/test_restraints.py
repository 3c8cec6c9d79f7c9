"""Settings of joints and supports become what scenes are solved with, and back."""

from dataclasses import replace

import numpy as np
import pytest

from dataset.dataset_fakes import block
from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.mesh import joint_frames
from mixpinn.physics.foundation import cap_nodes
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.records.joint_frame import JointFrame, save_joint_frames
from mixpinn.stages.restraints import (
    SLIDING_CAPS,
    TABLE,
    SupportConfig,
    describe,
    joints_between,
    settings_of_restraints,
    settled_joints,
    supported,
)
from mixpinn.stages.simulation import SimulationConfig, for_patients, make_scene


def lumbar():
    """Two rigid boxes in a block, called as neighbours; no anatomy, so that frames must be given."""
    mesh = block(6, size=8.0)
    part = np.zeros(mesh.n_points, dtype=np.int16)
    inner = (np.abs(mesh.points[:, 0]) < 9.0) & (np.abs(mesh.points[:, 1] + 20.0) < 9.0)
    part[inner & (mesh.points[:, 2] < -10.0) & (mesh.points[:, 2] > -14.0)] = 1
    part[inner & (mesh.points[:, 2] > 10.0) & (mesh.points[:, 2] < 14.0)] = 2
    return replace(mesh, part=part, rigid_names=("vertebrae_L4", "vertebrae_L5"))


@pytest.fixture
def frames(tmp_path) -> str:
    path = tmp_path / "joints.json"
    save_joint_frames([JointFrame("vertebrae_L5", "vertebrae_L4", (0.0, -20.0, 0.0), (
        (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), 30.0)], path)
    return str(path)


def test_defaults_leave_everything_as_it_was() -> None:
    mesh = lumbar()
    scene = make_scene(mesh, SimulationConfig())
    assert scene.mesh is mesh
    assert scene.restraints == FREE


def test_patients_get_joints_unless_discs_are_a_tissue() -> None:
    assert settled_joints("auto", ("body",)) == "in-vivo-prone"
    assert settled_joints("auto", ("body", "intervertebral_discs")) == "none"
    assert settled_joints("none", ("body",)) == "none"
    assert for_patients(SimulationConfig(joints="in-vitro"), ("body",)).joints == "in-vitro"
    assert for_patients(SimulationConfig(), ("body",)).joints == "in-vivo-prone"


def test_joints_come_from_a_file_of_frames(frames) -> None:
    mesh = lumbar()
    scene = make_scene(mesh, SimulationConfig(joints="in-vivo-prone", joint_frames=frames))
    assert [joint.frame.name for joint in scene.joints] == ["vertebrae_L4-vertebrae_L5"]
    with pytest.raises(InputError, match="cavity"):
        joints_between(mesh, "in-vitro")
    with pytest.raises(InputError, match="discs"):
        make_scene(replace(mesh, tissue_names=("discs",)), SimulationConfig(joints="in-vitro", joint_frames=frames))


@pytest.mark.parametrize(("given", "skin", "bones", "under"), [
    (SupportConfig(), "front", [], ()),
    (SupportConfig(front="table"), "none", [], (TABLE,)),
    (SupportConfig(front="free", held=("vertebrae_L5",)), "none", ["vertebrae_L5"], ()),
    (SupportConfig(front="table", caps="held"), "caps", [], (TABLE,)),
    (SupportConfig(caps="sliding"), "front", [], (SLIDING_CAPS,)),
])
def test_supports_fix_nodes_and_lay_foundations(given, skin, bones, under) -> None:
    mesh = lumbar()
    found, foundations = supported(mesh, given)
    assert foundations == under
    soft = found.fixed & (found.part == 0)
    expected = {"front": mesh.fixed, "none": np.zeros_like(soft), "caps": cap_nodes(mesh)}[skin]
    np.testing.assert_array_equal(soft, expected)
    held = [name for name, still in zip(found.rigid_names, found.held_parts, strict=True) if still]
    assert held == bones
    again = settings_of_restraints(found, Restraints((), foundations))[1]
    twice, same = supported(found, again)
    np.testing.assert_array_equal(twice.fixed, found.fixed)
    assert same == foundations
    told = describe(found, Restraints((), foundations))
    assert ("pad" in told["Supports"]) == (TABLE in under)
    assert all(name in told["Supports"] for name in bones)


def test_cut_bones_are_set_free_and_what_holds_nothing_is_refused() -> None:
    mesh = lumbar()
    cut = replace(mesh, fixed=mesh.fixed | (mesh.part == 1))
    assert cut.held_parts.tolist() == [True, False]
    assert not supported(cut, SupportConfig(cut="free"))[0].held_parts.any()
    with pytest.raises(InputError, match="holds the body"):
        supported(mesh, SupportConfig(front="free"))
    with pytest.raises(InputError, match="vertebrae_L4, vertebrae_L5"):
        supported(mesh, SupportConfig(held=("sacrum",)))


def test_settings_are_read_from_plain_values() -> None:
    found = build_config(SimulationConfig, {"joints": "in-vitro", "support": {"front": "table", "held": ["sacrum"]}})
    assert found.support == SupportConfig(front="table", held=("sacrum",))
    with pytest.raises(InputError, match="support"):
        build_config(SimulationConfig, {"support": {"front": "water"}})


def test_no_vertebrae_no_frames() -> None:
    assert joint_frames(block(4)) == ()
