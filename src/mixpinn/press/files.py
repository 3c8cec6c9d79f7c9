"""Keep what `PoseModel` needs beyond the hybrid model in a folder: probes, settings, correction; no pickle."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.error_law import PoseErrorLaw
from mixpinn.press.model import PoseCorrection, PoseModel
from mixpinn.press.probe_field import ProbeField
from mixpinn.press.records import PoseContactConfig, ProbeGeometry
from mixpinn.reduced.hybrid import BUNDLE, POSE_FILE, HybridModel

_FORMAT = 2
_FIELD = ("coefficients", "origin", "underside")
_CORRECTION = ("modes", "gain", "wrench_gain", "scale", "largest")


def save_pose_model(model: PoseModel, folder: Path | str) -> None:
    """Write ``pose.safetensors`` into `folder`: probes, correction and, as JSON in the same file, the settings.

    The hybrid model is kept by its own `HybridModel.save`.
    """
    arrays: dict[str, AnyArray] = {}
    for i, probe in enumerate(model.probes):
        arrays |= {f"probe{i}.{name}": getattr(probe.geometry, name) for name in ("vertices", "triangles")}
        arrays |= {f"probe{i}.{name}": getattr(probe, name) for name in _FIELD}
    if model.correction is not None:
        for name in _CORRECTION:
            arrays[f"correction.{name}"] = getattr(model.correction, name)
    write_arrays(Path(folder) / POSE_FILE, arrays, about={
        "format": _FORMAT, "mesh_hash": model.hybrid.mesh.hash(), "steps": model.steps,
        "spacings": [probe.spacing for probe in model.probes],
        "contact": asdict(model.contact.config), "corrected": model.correction is not None,
        "domain": model.domain.as_dict(), "error": None if model.error is None else model.error.as_dict(),
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
    try:
        if not isinstance(about, dict) or about["format"] != _FORMAT:
            raise KeyError("format")
        if about["mesh_hash"] != hybrid.mesh.hash():
            raise InputError(
                str(path), expected=f"a pose model of mesh {hybrid.mesh.hash()}", got=f"one of {about['mesh_hash']}",
                fix="fit the pose model on this mesh",
            )
        config = PoseContactConfig(**about["contact"])
        probes = tuple(_probe(arrays, i, float(spacing), config.gap) for i, spacing in enumerate(about["spacings"]))
        correction = None
        if about["corrected"]:
            correction = PoseCorrection(*(arrays[f"correction.{name}"] for name in _CORRECTION))
        contact = PriorContact.of_prior(hybrid.prior, config)
        error = None if about["error"] is None else PoseErrorLaw.of_dict(about["error"])
        domain = PoseDomain.of_dict(about["domain"])
        return PoseModel(hybrid, contact, probes, domain, correction, error, int(about["steps"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            str(path), expected="a complete pose model", got=repr(error), fix="fit the pose model again",
        ) from error


def _probe(arrays: Mapping[str, AnyArray], index: int, spacing: float, gap: float) -> ProbeField:
    of = {name: arrays[f"probe{index}.{name}"] for name in (*_FIELD, "vertices", "triangles")}
    geometry = ProbeGeometry(of["vertices"], of["triangles"])
    return ProbeField(of["coefficients"], of["origin"], spacing, of["underside"], gap, geometry)
