"""Keep what `PoseModel` needs beyond the hybrid model in a folder: probes, settings, correction; no pickle."""

from dataclasses import asdict
from pathlib import Path

from mixpinn.base.errors import InputError
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.press.contact import PriorContact
from mixpinn.press.model import PoseCorrection, PoseModel
from mixpinn.press.records import PoseContactConfig, ProbeGeometry
from mixpinn.reduced.hybrid import BUNDLE, POSE_FILE, HybridModel

_FORMAT = 1
_CORRECTION = ("modes", "gain", "wrench_gain", "scale")


def save_pose_model(model: PoseModel, folder: Path | str) -> None:
    """Write ``pose.safetensors`` into `folder`: probes, correction and, as JSON in the same file, the settings.

    The hybrid model is kept by its own `HybridModel.save`.
    """
    arrays = {}
    for i, probe in enumerate(model.probes):
        for name in ("vertices", "triangles", "samples"):
            arrays[f"probe{i}.{name}"] = getattr(probe, name)
    if model.correction is not None:
        for name in _CORRECTION:
            arrays[f"correction.{name}"] = getattr(model.correction, name)
    write_arrays(Path(folder) / POSE_FILE, arrays, about={
        "format": _FORMAT, "mesh_hash": model.hybrid.mesh.hash(), "probes": len(model.probes), "steps": model.steps,
        "contact": asdict(model.contact.config), "corrected": model.correction is not None,
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
        probes = tuple(
            ProbeGeometry(*(arrays[f"probe{i}.{name}"] for name in ("vertices", "triangles", "samples")))
            for i in range(int(about["probes"]))
        )
        correction = None
        if about["corrected"]:
            correction = PoseCorrection(*(arrays[f"correction.{name}"] for name in _CORRECTION))
        contact = PriorContact.of_prior(hybrid.prior, PoseContactConfig(**about["contact"]))
        return PoseModel(hybrid, contact, probes, correction, int(about["steps"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            str(path), expected="a complete pose model", got=repr(error), fix="fit the pose model again",
        ) from error
