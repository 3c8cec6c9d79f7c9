import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from dataset.dataset_fakes import block, plate
from mixpinn.base.errors import InputError
from mixpinn.dataset import SMALL, SimulationStore
from mixpinn.fem import (
    ContactConfig,
    Joint,
    JointFrame,
    LinearBushing,
    LinearElastic,
    NeutralZoneBushing,
    Scene,
    SolverConfig,
    StableNeoHookean,
    StableNeoHookeanLog,
    scene_hash,
    scene_record,
)
from mixpinn.fem.scene_record import recorded_contact, recorded_materials, recorded_restraints

MATERIALS = (
    StableNeoHookean(mu=1e-3 / 3, lam=0.1), StableNeoHookeanLog.from_young(0.02, 0.4), LinearElastic(mu=0.1, lam=1 / 7),
)
CONTACT = ContactConfig(gap=1.25, friction=0.3, stiffness=123.0)


@dataclass(frozen=True)
class StableNeoHookeanOfMine(StableNeoHookean):
    """A class of the user's own."""


def scene_of(*materials, **values):
    mesh = replace(block(3), tissue_names=tuple(f"tissue {i}" for i in range(len(materials))))
    return Scene(mesh, plate(), tuple(materials), **values)


def test_materials_and_contact_survive_a_round_trip_through_json():
    record = json.loads(json.dumps(scene_record(scene_of(*MATERIALS, contact=CONTACT))))
    assert recorded_materials(record, "store") == MATERIALS
    assert recorded_contact(record, "store") == CONTACT


def test_one_identity_of_scene_record_and_store(tmp_path):
    scene = scene_of(*MATERIALS, contact=CONTACT)
    record = scene_record(scene)
    store = SimulationStore.create(
        tmp_path, scene.mesh, protocol=SMALL, positions=np.zeros((0, 3)), poses=(), scene=record, probe=scene.probe,
    )
    assert scene.hash() == scene_hash(record, scene.mesh.hash()) == store.scene_hash
    again = SimulationStore.open(tmp_path)
    assert again.scene_hash == scene.hash()
    assert again.materials() == MATERIALS
    assert again.contact() == CONTACT
    np.testing.assert_allclose(np.sort(again.probe().points, axis=0), np.sort(scene.probe.points, axis=0))


def test_identity_knows_what_decides_the_result():
    scene = scene_of(MATERIALS[0])
    assert scene.hash() == replace(scene, solver=SolverConfig(threads=7)).hash()
    others = [
        replace(scene, solver=SolverConfig(tolerance=1e-5)), replace(scene, contact=CONTACT),
        replace(scene, materials=(StableNeoHookean(mu=1e-3 / 3, lam=0.1 + 1e-16),)),
        replace(scene, materials=(StableNeoHookeanLog(mu=1e-3 / 3, lam=0.1),)), replace(scene, probe=plate(5.0)),
        replace(scene, mesh=block(4)),
    ]
    assert len({scene.hash(), *(other.hash() for other in others)}) == 7


def test_a_material_of_the_users_own_is_refused_with_the_remedy():
    own = StableNeoHookeanOfMine(mu=1.0, lam=1.0)
    record = scene_record(scene_of(own))
    assert record["materials"][0]["kind"].endswith("test_scene_record.StableNeoHookeanOfMine")
    with pytest.raises(InputError, match="materials="):
        recorded_materials(record, "store")


@pytest.mark.parametrize("record", [{}, {"simulator": "SOFA"}, {"materials": [], "contact": {"gap": 2.0}}])
def test_what_is_not_recorded_is_not_guessed(record):
    with pytest.raises(InputError, match="--paper-constants"):
        recorded_materials(record, "store")
    with pytest.raises(InputError, match="friction"):
        recorded_contact(record, "store")


def test_damaged_constants_are_refused():
    with pytest.raises(InputError, match="mu"):
        recorded_materials({"materials": [{"kind": "StableNeoHookean", "mu": "soft", "lam": 1.0}]}, "store")


FRAME = JointFrame("A", "B", (1.0, 2.0, 3.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), 35.0)
JOINTS = (
    Joint(FRAME, LinearBushing.of_diagonal([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])),
    Joint(FRAME, NeutralZoneBushing((1.0,) * 6, (2.0,) * 6, (3.0,) * 6, (0.1,) * 6, (0.2,) * 6, (0.5,) * 6)),
)


@dataclass(frozen=True)
class BushingOfMine(LinearBushing):
    """A class of the user's own."""


def with_joints(*joints):
    mesh = block(3)
    part = mesh.part.copy()
    part[[0, 1]] = 1, 2
    return Scene(replace(mesh, part=part, rigid_names=("A", "B")), plate(), (MATERIALS[0],), joints=joints)


def test_joints_survive_a_round_trip_and_belong_to_the_identity(tmp_path):
    scene, bare = with_joints(*JOINTS), with_joints()
    record = json.loads(json.dumps(scene_record(scene)))
    assert recorded_restraints(record, "store").joints == JOINTS
    assert "joints" not in scene_record(bare)
    assert recorded_restraints(scene_record(bare), "store").joints == ()
    softer = with_joints(Joint(FRAME, LinearBushing.of_diagonal([1.0] * 6)), JOINTS[1])
    assert len({bare.hash(), scene.hash(), softer.hash(), with_joints(JOINTS[0]).hash()}) == 4
    store = SimulationStore.create(
        tmp_path, scene.mesh, protocol=SMALL, positions=np.zeros((0, 3)), poses=(), scene=record, probe=scene.probe,
    )
    assert store.scene_hash == scene.hash()
    assert SimulationStore.open(tmp_path).joints() == JOINTS


def test_a_joint_law_of_the_users_own_is_refused_with_the_remedy():
    record = scene_record(with_joints(Joint(FRAME, BushingOfMine(JOINTS[0].law.stiffness))))
    with pytest.raises(InputError, match=r"BushingOfMine.*joints="):
        recorded_restraints(record, "store")


@pytest.mark.parametrize("entries", [5, None, "front", {"face": "front"}, [5], [None]])
@pytest.mark.parametrize("name", ["joints", "foundations"])
def test_damaged_restraints_are_refused(name, entries):
    with pytest.raises(InputError, match="store"):
        recorded_restraints({name: entries}, "store")
