"""The prediction stage: a model folder and contact displacements in, the deformed mesh out."""

from pathlib import Path

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.progress import console
from mixpinn.records import Prediction
from mixpinn.serving.contact_source import SampleAddress, read_contacts, read_sample
from mixpinn.serving.hybrid_predictor import HybridPredictor, ProbeAddress
from mixpinn.serving.load import load_predictor


def predict_stage(
    model: Path | str, source: Path | str | SampleAddress | ProbeAddress, out: Path | str, *,
    threads: int | None = None,
) -> Prediction:
    """Predict and write the deformed mesh.

    Args:
        model: folder that training wrote.
        source: file of contact nodes and displacements (see `read_contacts`), or a sample of a store, whose
            displacement is then written beside the prediction, with the error; or a pose of the probe, where the
            model takes one.
        out: ``.vtu`` with all fields, or the deformed surface as ``.stl`` or ``.ply``.
        threads: CPU threads; None leaves them as they are.

    Raises:
        InputError: the model is damaged or of another topology; the contacts are unreadable, unknown to the mesh or
            not finite; the store has no such sample; or `out` has another suffix.

    Example:
        >>> prediction = predict_stage("runs/model", "contacts.csv", "deformed.vtu")
    """
    predictor = load_predictor(model, threads=threads)
    if isinstance(source, ProbeAddress):
        if not isinstance(predictor, HybridPredictor):
            raise InputError(
                str(model), expected="a hybrid model, which takes the probe's pose", got="a network",
                fix="give contact displacements, or train with --model hybrid",
            )
        pressed = predictor.press(np.array([source.tip]), rotation_deg=np.array([source.rotation_deg]))
        x, y, z = pressed.wrench[0, :3]
        console.print(f"Force on the probe: {np.hypot(np.hypot(x, y), z):.2f} N ({x:.2f}, {y:.2f}, {z:.2f})")
        for name, twist in zip(predictor.mesh.rigid_names, pressed.twists, strict=True):
            console.print(
                f"{name}: moved by {np.linalg.norm(twist[:3]):.2f} mm, turned by "
                f"{np.rad2deg(np.linalg.norm(twist[3:])):.2f}°"
            )
        prediction = Prediction(predictor.mesh, pressed.displacement, None, predictor.name)
    elif isinstance(source, SampleAddress):
        sample = read_sample(source, mesh_hash=predictor.mesh_hash)
        prediction = predictor.predict_at(
            sample.contact_nodes, sample.contact_displacement, reference=sample.displacement,
        )
    else:
        prediction = predictor.predict_at(*read_contacts(source))
    prediction.save(out)
    return prediction
