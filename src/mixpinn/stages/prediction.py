"""The prediction stage: contact displacements from a file or from a sample of a store in, an answer out."""

from pathlib import Path

from mixpinn.records.answer import Answer, discretisation_of
from mixpinn.serving.contact_sense import check_contacts
from mixpinn.serving.contact_source import SampleAddress, read_contacts, read_sample
from mixpinn.serving.load import AnyPredictor


def answer_contacts(predictor: AnyPredictor, source: Path | str | SampleAddress) -> Answer:
    """Predict from contact displacements.

    Args:
        predictor: a loaded model.
        source: file of contact nodes and displacements (see `read_contacts`), or a sample of a store, whose
            displacement is then the answer's reference.

    Raises:
        InputError: the contacts are unreadable, unknown to the mesh or not finite, or the store has no such sample.

    Example:
        >>> from mixpinn.face import load
        >>> answer_contacts(load("runs/model"), "contacts.csv").save("deformed.vtu")
    """
    if not isinstance(source, SampleAddress):
        nodes, displacements = read_contacts(source)
        check_contacts(predictor.mesh, nodes, displacements, what=str(source))
        return predictor.predict_at(nodes, displacements)
    sample = read_sample(source, mesh_hash=predictor.mesh_hash, made_on=discretisation_of(predictor.mesh))
    return predictor.predict_at(sample.contact_nodes, sample.contact_displacement, reference=sample.displacement)
