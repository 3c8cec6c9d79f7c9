"""Load a trained model once, predict many times."""

from mixpinn.serving.contact_source import SampleAddress, read_contacts, read_sample
from mixpinn.serving.hybrid_predictor import Assessment, HybridPredictor, ProbeAddress
from mixpinn.serving.load import AnyPredictor, load_predictor
from mixpinn.serving.predictor import Predictor, contact_field

__all__ = [
    "AnyPredictor", "Assessment", "HybridPredictor", "Predictor", "ProbeAddress", "SampleAddress", "contact_field",
    "load_predictor", "read_contacts", "read_sample",
]
