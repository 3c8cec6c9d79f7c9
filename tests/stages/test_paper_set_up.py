"""Without joints, further bones, layers, supports and membrane the paper's set-up is solved as it always was."""

from dataclasses import replace

import numpy as np
import pytest

from mixpinn.fem import PAPER_TISSUE, Joint, LinearBushing, PoseSimulator, Scene, SolverConfig
from mixpinn.fem.material.tissue_presets import TissuePreset
from mixpinn.mesh import joint_frames, load_paper_mesh
from mixpinn.physics.foundation import Face, Foundation
from mixpinn.physics.membrane import Membrane
from mixpinn.records import Probe, ProbePath
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy
from mixpinn.stages.simulation import PAPER_TISSUE_CONFIG, SimulationConfig, make_scene

TIPS = ((30.0, 133.0, -55.0), (50.0, 133.0, -15.0))
"""Two of the paper's positions on its mesh, the probe not turned."""


def press(scene: Scene, place: tuple[float, float, float]):
    depths = np.array([-4.0, 0.0, 3.0, 6.0])
    tips = np.array(place) - depths[:, None] * np.array([0.0, 1.0, 0.0])
    return PoseSimulator(scene).run(ProbePath(tips, np.tile(np.eye(3), (len(depths), 1, 1)), depths))


@pytest.fixture(scope="module")
def setting(shared_data):
    folder = shared_data / "patient1" / "paper"
    return load_paper_mesh(folder), folder / "probe_collision.stl"


@pytest.fixture(scope="module")
def plain(setting):
    mesh, probe = setting
    scene = Scene(mesh, Probe.load(probe), (PAPER_TISSUE,), solver=SolverConfig(threads=1))
    return scene, [press(scene, place) for place in TIPS]


def assert_same(found, expected) -> None:
    for one, other in zip(found, expected, strict=True):
        assert one.converged.all()
        assert np.abs(other.probe_wrench).max() > 1.0
        for name in ("displacement", "probe_wrench", "part_translation", "part_rotation"):
            value, known = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(value, known, rtol=0.0, atol=1e-9 * np.abs(known).max())


def test_settings_that_name_nothing_give_the_plain_scene(setting, plain) -> None:
    mesh, probe = setting
    config = SimulationConfig(
        tissue=PAPER_TISSUE_CONFIG, probe=str(probe), joints="none", moduli=TissuePreset.NONE,
    )
    scene = make_scene(mesh, config)
    assert (scene.joints, scene.foundations, scene.membrane) == ((), (), None)
    assert scene.mesh.hash() == mesh.hash()
    assert_same([press(scene, place) for place in TIPS], plain[1])


def test_what_has_no_stiffness_changes_nothing(plain) -> None:
    scene, expected = plain
    joints = [Joint(frame, LinearBushing.of_diagonal([0.0] * 6)) for frame in joint_frames(scene.mesh)]
    there = replace(
        scene, joints=tuple(joints), foundations=(Foundation(Face.FRONT, 0.0, sink=5.0),), membrane=Membrane(),
    )
    assert len(there.joints) == 4
    assert_same([press(there, place) for place in TIPS], expected)


def test_the_papers_parts_are_those_that_were_named_before_there_were_others(shared_data) -> None:
    source = str(shared_data / "patient2" / "segmentations")
    lumbar = tuple(f"vertebrae_L{number}" for number in range(1, 6))
    found, before = (
        make_anatomy(AnatomyConfig(source="folder", path=source, repair=True, **settings)).label_map
        for settings in ({"paper_parts": True}, {"rigid": lumbar})
    )
    assert found.hash() == before.hash()
    assert found.rigid_names == lumbar
