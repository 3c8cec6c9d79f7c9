import json

import numpy as np
import pytest

from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.dataset import SimulationStore
from mixpinn.stages.evaluation import Background, EvaluationConfig, build_prior, evaluate_models
from mixpinn.stages.simulation import SimulationConfig, TissueConfig
from mixpinn.stages.training import SplitConfig, load_samples
from pipeline.chain import SIMULATION

QUICK = EvaluationConfig(pictures=False)


@pytest.fixture
def store(chain):
    return SimulationStore.open(chain.simulation / "store")


@pytest.fixture
def samples(store):
    return load_samples(store, SplitConfig())


def test_baselines_alone(store, samples, tmp_path):
    table, split = samples
    background = Background(title="Nothing trained", simulation=build_config(SimulationConfig, SIMULATION))
    evaluations, report = evaluate_models([], store, table, split, QUICK, out=tmp_path, background=background)
    zero, prior, stepped = evaluations
    test = table.at_positions(split.test)
    # Predicting rest errs by the displacement itself.
    np.testing.assert_allclose(zero.metrics["mee"], np.linalg.norm(test.displacement, axis=2).mean(axis=1), rtol=1e-5)
    assert prior.metrics["mee"].mean() < 0.2 * zero.metrics["mee"].mean()
    assert stepped.metrics["mee"].mean() < prior.metrics["mee"].mean()
    assert "Nothing trained" in report.read_text()
    written = json.loads((tmp_path / "run.json").read_text())["results"]
    assert written[zero.model] == pytest.approx(zero.metrics["mee"].mean())


def test_finished_evaluation_is_read_again(store, samples, tmp_path):
    table, split = samples
    first, report = evaluate_models([], store, table, split, QUICK, out=tmp_path)
    written = report.stat().st_mtime_ns
    second, again = evaluate_models([], store, table, split, QUICK, out=tmp_path)
    assert again.stat().st_mtime_ns == written
    assert [evaluation.model for evaluation in second] == [evaluation.model for evaluation in first]
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.metrics["mee"], other.metrics["mee"])
    report.unlink()
    evaluate_models([], store, table, split, QUICK, out=tmp_path)
    assert report.is_file()
    with pytest.raises(InputError, match="another seed, config"):
        evaluate_models([], store, table, split, EvaluationConfig(pictures=False, seed=1), out=tmp_path)


def test_missing_model_leaves_nothing(store, samples, tmp_path):
    with pytest.raises(InputError, match="absent"):
        evaluate_models([tmp_path / "absent"], store, *samples, QUICK, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_prior_is_kept_and_made_anew_where_the_cache_is_damaged(store, samples, tmp_path, monkeypatch):
    monkeypatch.setenv("MIXPINN_CACHE", str(tmp_path))
    table, _ = samples
    first = build_prior(store.mesh(), {}, TissueConfig(), table)
    for path in tmp_path.rglob("*"):
        if path.is_file():
            path.write_bytes(path.read_bytes()[:-9])
    second = build_prior(store.mesh(), {}, TissueConfig(), table)
    third = build_prior(store.mesh(), {}, TissueConfig(), table)
    np.testing.assert_array_equal(first.compliance, second.compliance)
    np.testing.assert_array_equal(first.compliance, third.compliance)
