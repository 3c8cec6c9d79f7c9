"""The skin as a membrane among the settings: a scene has it, a store of it knows it, the default has none."""

import pytest

from fem.block_mesh import two_bones
from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.fem.material.skin_presets import MEMBRANES, SLOPE, TENSION, THICKNESS, SkinPreset, preset_of
from mixpinn.fem.scene_record import recorded_restraints, scene_record
from mixpinn.physics.membrane import Membrane
from mixpinn.stages.restraints import describe
from mixpinn.stages.simulation import SimulationConfig, make_scene


@pytest.mark.parametrize("name", list(SkinPreset))
def test_a_scene_has_the_membrane_that_is_named_and_its_record_keeps_it(name) -> None:
    scene = make_scene(two_bones(), build_config(SimulationConfig, {"membrane": str(name)}))
    assert scene.membrane == MEMBRANES[name]
    record = scene_record(scene)
    assert ("membrane" in record) == (name is not SkinPreset.NONE)
    assert recorded_restraints(record, "here") == scene.restraints
    assert preset_of(scene.membrane) is name
    assert ("Skin" in describe(scene.mesh, scene.restraints)) == (name is not SkinPreset.NONE)


def test_presets_lie_within_their_sources() -> None:
    for figure in (TENSION, SLOPE, THICKNESS):
        assert figure.low <= figure.value <= figure.high
    elastic = MEMBRANES[SkinPreset.ELASTIC]
    assert elastic is not None
    assert SLOPE.low * THICKNESS.low < 3.0 * elastic.shear < SLOPE.high * THICKNESS.high


def test_other_names_and_membranes_of_ones_own_are_refused() -> None:
    with pytest.raises(InputError, match="membrane"):
        build_config(SimulationConfig, {"membrane": "leather"})
    with pytest.raises(InputError, match="Python"):
        preset_of(Membrane(shear=7.0))
