import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from dataset.dataset_fakes import block, plate
from mixpinn.base.errors import InputError
from mixpinn.dataset import SMALL, SimulationStore
from mixpinn.fem import (
    ContactConfig,
    LinearElastic,
    Scene,
    SolverConfig,
    StableNeoHookean,
    StableNeoHookeanLog,
    scene_hash,
    scene_record,
)
from mixpinn.fem.scene_record import recorded_contact, recorded_materials

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
