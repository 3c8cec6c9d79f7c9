"""Scenes with other joints and supports than the bundle's own."""

from dataclasses import replace

import numpy as np
import pytest

from fem.block_mesh import carved, labelled, two_bones
from mixpinn.fem import Scene, StableNeoHookean
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.physics.joint_system import Joint
from mixpinn.physics.joints import LinearBushing
from mixpinn.records.joint_frame import JointFrame
from mixpinn.stages.budget.restraints import HELD, JOINTS, SUPPORT, restraint_variants, restraints_present
from mixpinn.stages.restraints import SLIDING_CAPS, TABLE

LAW = LinearBushing(np.eye(6).tolist())


@pytest.fixture(scope="module")
def scene():
    block = carved(two_bones())
    fixed = (block.points[:, 1] < 1e-9) & (block.part == 0)
    mesh = labelled(block.points, block.cells, part=block.part, fixed=fixed)
    return Scene(mesh, spherical_probe(radius=8.0, subdivisions=2), (StableNeoHookean.from_young(25.4e-3, 0.45),))


def changed(scene):
    return {variant.source: variant.scene() for variant in restraint_variants(scene)}


def jointed(scene):
    frame = JointFrame(*scene.mesh.rigid_names, (30.0, 15.0, 16.0), np.eye(3).tolist())
    return replace(scene, joints=(Joint(frame, LAW),))


def test_a_body_that_is_held_in_front_is_laid_on_a_table(scene):
    found = changed(scene)
    assert found.keys() == {SUPPORT}
    assert found[SUPPORT].foundations == (TABLE,)
    assert not found[SUPPORT].mesh.fixed.any()
    assert restraints_present(SUPPORT, scene) == "anterior"


def test_a_body_on_a_table_is_held_in_front_and_keeps_its_caps(scene):
    lying = replace(
        scene, mesh=replace(scene.mesh, fixed=np.zeros(scene.mesh.n_points, bool)), foundations=(TABLE, SLIDING_CAPS),
    )
    found = changed(lying)[SUPPORT]
    assert found.foundations == (SLIDING_CAPS,)
    assert found.mesh.fixed.any()
    assert restraints_present(SUPPORT, lying) == "table"


def test_joints_are_taken_away(scene):
    found = changed(jointed(scene))
    assert found[JOINTS].joints == ()
    assert restraints_present(JOINTS, jointed(scene)) == "its own"
    assert restraints_present(JOINTS, scene) == "none"


def test_held_bones_are_let_go_and_skin_stays_held(scene):
    mesh = scene.mesh
    held = replace(scene, mesh=replace(mesh, fixed=mesh.fixed | (mesh.part == 1)))
    found = changed(held)
    assert not found[HELD].mesh.held_parts.any()
    assert np.array_equal(found[HELD].mesh.fixed, mesh.fixed)
    assert found[SUPPORT].mesh.held_parts.tolist() == [True, False]
    assert restraints_present(HELD, held) == mesh.rigid_names[0]


def test_bones_that_alone_hold_the_body_are_not_let_go(scene):
    held = replace(scene, mesh=replace(scene.mesh, fixed=scene.mesh.part == 1))
    assert HELD not in changed(held)
