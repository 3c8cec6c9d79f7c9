"""The paper's training settings, and refusal of settings that make no training."""

import pytest

from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.networks import MODELS
from mixpinn.training import PAPER_TRAINING, PHYSGNN_TRAINING, TrainConfig


def test_defaults_are_the_papers() -> None:
    config = PAPER_TRAINING
    assert (config.learning_rate, config.weight_decay, config.batch_size) == (5e-4, 0.01, 4)
    assert (config.decay_factor, config.decay_patience, config.min_learning_rate) == (0.1, 5, 1e-8)
    assert config.stop_patience == 15
    assert (PHYSGNN_TRAINING.learning_rate, PHYSGNN_TRAINING.batch_size) == (0.005, 8)


@pytest.mark.parametrize(("name", "value"), [
    ("learning_rate", 0.0), ("learning_rate", float("nan")), ("weight_decay", -1.0), ("decay_factor", 1.0),
    ("decay_patience", 0), ("stop_patience", 0), ("batch_size", 0), ("max_epochs", 0), ("seed", -1), ("threads", 0),
    ("time_budget", 0.0), ("min_learning_rate", -1.0),
])
def test_senseless_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        TrainConfig(**{name: value})


@pytest.mark.parametrize("values", [{"precision": "float16"}, {"learning_rat": 0.1}, {"batch_size": "many"}])
def test_unknown_settings_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(InputError):
        build_config(TrainConfig, values)


@pytest.mark.parametrize("name", ["mixpinn", "simple-gat", "physgnn"])
def test_a_model_takes_its_own_numbers_where_none_are_given(name: str) -> None:
    own = PHYSGNN_TRAINING if name == "physgnn" else PAPER_TRAINING
    found = TrainConfig(max_epochs=7).for_model(MODELS[name])
    assert (found.learning_rate, found.batch_size, found.max_epochs) == (own.learning_rate, own.batch_size, 7)
    assert found.for_model(MODELS["mixpinn"]) == found  # resolved once


def test_given_numbers_stand_even_where_they_are_another_models_own() -> None:
    given = TrainConfig(learning_rate=PAPER_TRAINING.learning_rate, batch_size=PAPER_TRAINING.batch_size)
    found = given.for_model(MODELS["physgnn"])
    assert (found.learning_rate, found.batch_size) == (5e-4, 4)
    with pytest.raises(InputError, match="min_learning_rate"):
        TrainConfig(min_learning_rate=1e-3).for_model(MODELS["mixpinn"])
