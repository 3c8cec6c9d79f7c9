"""The toy bundle, made once."""

import pytest

from mixpinn.serving import HybridPredictor
from serving.live.pressed import block_predictor


@pytest.fixture(scope="session")
def pressing() -> HybridPredictor:
    """A predictor of the block that takes poses."""
    return block_predictor()
