"""The prediction stage: a model folder and contact displacements in, the deformed mesh out."""

from pathlib import Path

from mixpinn.records import Prediction
from mixpinn.serving.contact_source import SampleAddress, read_contacts, read_sample
from mixpinn.serving.load import load_predictor


def predict_stage(
    model: Path | str, source: Path | str | SampleAddress, out: Path | str, *, threads: int | None = None,
) -> Prediction:
    """Predict and write the deformed mesh.

    Args:
        model: folder that training wrote.
        source: file of contact nodes and displacements (see `read_contacts`), or a sample of a store, whose
            displacement is then written beside the prediction, with the error.
        out: ``.vtu`` with all fields, or the deformed surface as ``.stl`` or ``.ply``.
        threads: CPU threads; None leaves them as they are.

    Raises:
        InputError: the model is damaged or of another topology; the contacts are unreadable, unknown to the mesh or
            not finite; the store has no such sample; or `out` has another suffix.

    Example:
        >>> predict_stage("runs/model", "contacts.csv", "deformed.vtu")
    """
    predictor = load_predictor(model, threads=threads)
    if isinstance(source, SampleAddress):
        sample = read_sample(source, mesh_hash=predictor.mesh_hash)
        prediction = predictor.predict_at(
            sample.contact_nodes, sample.contact_displacement, reference=sample.displacement,
        )
    else:
        prediction = predictor.predict_at(*read_contacts(source))
    prediction.save(out)
    return prediction
