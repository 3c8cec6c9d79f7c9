"""Keep what `PoseModel` needs beyond the hybrid model in a folder: probes, settings, correction; no pickle."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.base.validated import ArraySpec, checked_record
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.error_law import PoseErrorLaw
from mixpinn.press.fine_skin import FineContact, FineSkin
from mixpinn.press.force_law import TERMS, ForceLaw
from mixpinn.press.grip import SIGNS
from mixpinn.press.model import PoseCorrection, PoseModel
from mixpinn.press.probe_field import ProbeField
from mixpinn.press.records import PoseContactConfig
from mixpinn.records import Probe
from mixpinn.records.answer import discretisation_of
from mixpinn.reduced.hybrid import BUNDLE, POSE_FILE, HybridModel

_FORMAT = 4
_NO_FINE_SKIN = 3
"""The format before forces were told on finer skin: a law had one sign less, which counts nothing there."""
_FLAT_FACES = 2
"""The format in which contact took faces of six nodes for four flat triangles: what it learned belongs to that."""
_REMAKE = "fit the pose model again"
_FIELD = {
    "coefficients": ArraySpec("number", ("x", "y", "z")), "origin": ArraySpec("number", (3,)),
    "underside": ArraySpec("number", ("x", "z"), finite=False),
}
_SURFACE = {"vertices": ArraySpec("number", ("p", 3)), "triangles": ArraySpec("index", ("t", 3), low=0)}
_CORRECTION = {
    "modes": ArraySpec("number", ("modes", "unknowns")), "gain": ArraySpec("number", ("features", "modes")),
    "wrench_gain": ArraySpec("number", ("features", 6)), "scale": ArraySpec("number", ("coordinates",)),
    "largest": ArraySpec("number", (2,), finite=False),
}
_LAW = {
    "along": ArraySpec("number", (SIGNS,)), "largest": ArraySpec("number", (1,)), "axes": ArraySpec("number", (2, 3)),
    "across": ArraySpec("number", (2, TERMS)),
}
_Positive = Annotated[float, Field(gt=0.0)]


@dataclass(frozen=True)
class _Error:
    """A `PoseErrorLaw` in JSON."""

    coefficients: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
    factor: tuple[float, float, float]
    level: float


@dataclass(frozen=True)
class _About:
    """What ``pose.safetensors`` says besides its arrays."""

    format: Literal[2, 3, 4]
    mesh_hash: str
    steps: Annotated[int, Field(ge=0, le=1_000)]
    spacings: tuple[_Positive, ...]
    contact: PoseContactConfig
    corrected: bool
    domain: PoseDomain
    error: _Error | None
    bend: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    law: bool = False
    law_moves: bool = True
    fine: bool = False


def save_pose_model(model: PoseModel, folder: Path | str) -> None:
    """Write ``pose.safetensors`` into `folder`: probes, correction and, as JSON in the same file, the settings.

    The hybrid model is kept by its own `HybridModel.save`.
    """
    arrays: dict[str, AnyArray] = {}
    for i, field in enumerate(model.probes):
        arrays |= {f"probe{i}.vertices": field.probe.points, f"probe{i}.triangles": field.probe.triangles}
        arrays |= {f"probe{i}.{name}": getattr(field, name) for name in _FIELD}
    if model.correction is not None:
        for name in _CORRECTION:
            arrays[f"correction.{name}"] = getattr(model.correction, name)
    if model.law is not None:
        arrays |= {f"law.{name}": value for name, value in model.law.arrays().items()}
    if model.fine is not None:
        arrays |= {f"fine.{name}": value for name, value in model.fine.skin.arrays().items()}
    write_arrays(Path(folder) / POSE_FILE, arrays, about={
        "format": _FORMAT, "mesh_hash": model.hybrid.mesh.hash(), "steps": model.steps,
        "spacings": [probe.spacing for probe in model.probes],
        "contact": asdict(model.contact.config), "corrected": model.correction is not None,
        "domain": model.domain.as_dict(), "error": None if model.error is None else model.error.as_dict(),
        "bend": model.bend, "law": model.law is not None,
        "law_moves": model.law is None or model.law.moves, "fine": model.fine is not None,
    })
    seal = BUNDLE.seal_more if BUNDLE.is_sealed(folder) else BUNDLE.seal
    seal(folder, [POSE_FILE])


def load_pose_model(folder: Path | str, hybrid: HybridModel) -> PoseModel:
    """Read what `save_pose_model` wrote, on the same hybrid model.

    Raises:
        InputError: absent, damaged, or of another mesh.
    """
    path = Path(folder) / POSE_FILE
    BUNDLE.check(folder, POSE_FILE)
    arrays, about = read_arrays(path)
    values = checked_record(_About, about, str(path), remake=_REMAKE)
    if values.mesh_hash != hybrid.mesh.hash():
        raise InputError(
            str(path), expected=f"a pose model of {discretisation_of(hybrid.mesh)}",
            got=f"one of another mesh, {values.mesh_hash}",
            fix="copy the whole bundle that this file came with, or fit it again for this mesh (mixpinn onboard)",
        )
    if values.format == _FLAT_FACES and hybrid.mesh.order == 2 and values.corrected:
        raise InputError(
            str(path), expected="a pose model of curved faces", got="one of an earlier version, of flat ones",
            fix=_REMAKE,
        )
    try:
        probes = tuple(
            _probe(arrays, i, spacing, values.contact.gap, str(path)) for i, spacing in enumerate(values.spacings)
        )
        correction = None
        if values.corrected:
            found = {name: arrays[f"correction.{name}"] for name in _CORRECTION}
            _check(found, _CORRECTION, str(path), {"unknowns": hybrid.prior.coordinates.size})
            correction = PoseCorrection(*found.values())
        law = None
        if values.law:
            told = {name: arrays[f"law.{name}"] for name in _LAW}
            if values.format <= _NO_FINE_SKIN:
                told["along"] = np.append(told["along"], 0.0)
            _check(told, _LAW, str(path), {})
            law = ForceLaw.of_arrays(told, moves=values.law_moves)
        fine = _fine(arrays, hybrid, values.contact, str(path)) if values.fine else None
        error = None if values.error is None else PoseErrorLaw.of_dict(asdict(values.error))
    except (KeyError, TypeError, ValueError) as wrong:
        raise InputError(str(path), expected="a complete pose model", got=repr(wrong), fix=_REMAKE) from wrong
    contact = PriorContact.of_prior(hybrid.prior, values.contact)
    return PoseModel(hybrid, contact, probes, values.domain, correction, error, values.steps, values.bend, law, fine)


def _check(arrays: Mapping[str, AnyArray], specs: Mapping[str, ArraySpec], where: str, extents: dict[str, int]) -> None:
    for name, spec in specs.items():
        spec.check(arrays[name], f"{where}: {name}", extents=extents, remake=_REMAKE)


def _fine(arrays: Mapping[str, AnyArray], hybrid: HybridModel, config: PoseContactConfig, where: str) -> FineContact:
    """Contact on the finer skin."""
    of = {name.removeprefix("fine."): array for name, array in arrays.items() if name.startswith("fine.")}
    skin = FineSkin.of_arrays(of, candidates=len(hybrid.prior.nodes), where=where, remake=_REMAKE)
    return FineContact.of_prior(skin, hybrid.prior, stiffness=config.stiffness)


def _probe(arrays: Mapping[str, AnyArray], index: int, spacing: float, gap: float, where: str) -> ProbeField:
    of = {name: arrays[f"probe{index}.{name}"] for name in (*_FIELD, *_SURFACE)}
    _check(of, _FIELD | _SURFACE, f"{where}: probe {index}", {})
    _check(of, {"triangles": ArraySpec("index", ("t", 3), low=0, high=len(of["vertices"]) - 1)}, where, {})
    probe = Probe(of["vertices"], of["triangles"])
    return ProbeField(of["coefficients"], of["origin"], spacing, of["underside"], gap, probe)
