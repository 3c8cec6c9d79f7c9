"""Load a trained model once, predict many times.

Networks bring torch along; it is imported when one is loaded, never for a hybrid model.
"""

from typing import TYPE_CHECKING, Any

from mixpinn.serving.contact_source import SampleAddress, read_contacts, read_sample
from mixpinn.serving.hybrid_predictor import HybridPredictor
from mixpinn.serving.load import AnyPredictor, load_predictor

if TYPE_CHECKING:
    from mixpinn.serving.predictor import Predictor

__all__ = [
    "AnyPredictor", "HybridPredictor", "Predictor", "SampleAddress", "load_predictor", "read_contacts", "read_sample",
]


def __getattr__(name: str) -> Any:
    if name == "Predictor":
        from mixpinn.serving.predictor import Predictor

        return Predictor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
