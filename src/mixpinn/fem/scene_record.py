"""The record of a scene: what results depend on besides mesh and path, as plain values, and what is read back from it.

A store of simulations keeps this record; whoever needs the materials or the contact of the simulations asks the store,
so that no second copy of them exists. The hash of the record with that of the mesh is the identity of the scene.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.fem.contact.model import ContactConfig
from mixpinn.fem.local_refinement import LocalRefinement
from mixpinn.fem.material.hyperelastic import LinearElastic, Material, StableNeoHookean, StableNeoHookeanLog
from mixpinn.physics.restraints import FOUNDATIONS, JOINTS, Restraints
from mixpinn.records.plain import KIND, plain

BUILT_IN: dict[str, type[StableNeoHookean | StableNeoHookeanLog | LinearElastic]] = {
    law.__name__: law for law in (StableNeoHookean, StableNeoHookeanLog, LinearElastic)
}
"""Materials that a record can be turned back into."""

_SAY_IT = (
    "import the recordings into another folder and say what they were made with (--paper-constants, --scene, or "
    "tissue.mu, tissue.lam and contact.*)"
)


def scene_record(scene: object) -> dict[str, Any]:
    """What results depend on besides mesh and path, as plain values that survive a round trip through JSON.

    The probe counts by the hash of its geometry; the mesh is left out (it has its own hash), and so are thread
    counts, which change how fast a result comes but not what it is.

    Args:
        scene: a frozen dataclass, such as `mixpinn.fem.Scene`.
    """
    assert is_dataclass(scene)
    record = {field.name: plain(getattr(scene, field.name)) for field in fields(scene) if field.name != "mesh"}
    # What is not there is left out, so that a scene without it keeps the identity it had before there was such a thing.
    return {
        key: value for key, value in record.items()
        if value is not None and (value or key not in (JOINTS, FOUNDATIONS))
    }


def scene_hash(record: Mapping[str, Any], mesh_hash: str) -> str:
    """Identity of a scene from its record and the hash of its mesh, 16 hex digits."""
    text = json.dumps({"mesh": mesh_hash, **record}, sort_keys=True)
    return hash_arrays(np.frombuffer(text.encode(), dtype=np.uint8))


def recorded_materials(record: Mapping[str, Any], where: str) -> tuple[Material, ...]:
    """One material for each tissue of the mesh, rebuilt from the record of a scene.

    Args:
        record: what `scene_record` made.
        where: whose record it is, for the message.

    Raises:
        InputError: the record says nothing of materials, or names a class of the user's, which it cannot rebuild.
    """
    entries = record.get("materials")
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise InputError(where, expected="recorded constants of the tissue", got="none", fix=_SAY_IT)
    return tuple(_material(entry, where) for entry in entries)


def _material(entry: Any, where: str) -> Material:
    kind = entry.get(KIND) if isinstance(entry, Mapping) else entry
    if kind not in BUILT_IN:
        raise InputError(
            where, expected="materials of " + ", ".join(BUILT_IN), got=f"the class {kind!r}, which is not built in",
            fix="call the stage from Python and pass the material objects (materials=...)",
        )
    constants = {key: value for key, value in entry.items() if key != KIND} if isinstance(entry, Mapping) else {}
    return build_config(BUILT_IN[kind], constants)


def recorded_contact(record: Mapping[str, Any], where: str) -> ContactConfig:
    """Gap, friction and stiffness of contact, read back from the record of a scene.

    Recordings of other programs know gap, alarm distance and friction; the rest then has its defaults.

    Raises:
        InputError: the record says nothing of them.
    """
    entry = record.get("contact")
    missing = [name for name in ("gap", "friction") if not isinstance(entry, Mapping) or name not in entry]
    if missing:
        raise InputError(where, expected="recorded contact settings", got=f"no {' and no '.join(missing)}", fix=_SAY_IT)
    assert isinstance(entry, Mapping)
    return build_config(ContactConfig, {key: value for key, value in entry.items() if key != KIND})


def recorded_restraints(record: Mapping[str, Any], where: str) -> Restraints:
    """Joints and foundations, rebuilt from the record of a scene; none where it has none.

    Raises:
        InputError: a law of the user's own, which the record names but cannot rebuild, or a damaged entry.
    """
    return Restraints.of_record(record, where)


def recorded_refinement(record: Mapping[str, Any]) -> LocalRefinement | None:
    """How cells were refined under the probe; None where they were not."""
    entry = record.get("refinement")
    return refinement_of(entry) if isinstance(entry, Mapping) else None


def refinement_of(entry: Mapping[str, Any]) -> LocalRefinement:
    """The refinement that a scene's record or a bundle holds."""
    before: dict[str, Any] = {"order": 1.0, "held": None}  # as it was when a record does not say
    entry = before | {key: value for key, value in entry.items() if key != KIND}
    return build_config(LocalRefinement, entry)
