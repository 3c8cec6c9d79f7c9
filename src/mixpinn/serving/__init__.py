"""Load a trained model once, predict many times."""

from mixpinn.serving.contact_source import SampleAddress, read_contacts, read_sample
from mixpinn.serving.predictor import Predictor, contact_field
from mixpinn.serving.stage import predict_stage

__all__ = ["Predictor", "SampleAddress", "contact_field", "predict_stage", "read_contacts", "read_sample"]
