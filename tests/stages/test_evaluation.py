import json
from dataclasses import replace

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.dataset import SimulationStore
from mixpinn.fem import StableNeoHookean
from mixpinn.stages.evaluation import Background, EvaluationConfig, constants, evaluate_models
from mixpinn.stages.samples import SplitConfig, load_samples

QUICK = EvaluationConfig(pictures=False)


@pytest.fixture
def store(chain):
    return SimulationStore.open(chain.simulation / "store")


@pytest.fixture
def samples(store):
    return load_samples(store, SplitConfig())


def test_baselines_alone(store, samples, tmp_path):
    table, split = samples
    background = Background(title="Nothing trained")
    evaluations, report = evaluate_models(store, table, split, [], QUICK, out=tmp_path, background=background)
    zero, prior, stepped = evaluations
    test = table.at_positions(split.test)
    # Predicting rest errs by the displacement itself.
    np.testing.assert_allclose(zero.metrics["mee"], np.linalg.norm(test.displacement, axis=2).mean(axis=1), rtol=1e-5)
    assert prior.metrics["mee"].mean() < 0.2 * zero.metrics["mee"].mean()
    assert stepped.metrics["mee"].mean() < prior.metrics["mee"].mean()
    assert "Nothing trained" in report.read_text()
    assert "StableNeoHookean" in report.read_text()
    written = json.loads((tmp_path / "run.json").read_text())["results"]
    assert written[zero.model] == pytest.approx(zero.metrics["mee"].mean())


def test_finished_evaluation_is_read_again(store, samples, tmp_path):
    table, split = samples
    first, report = evaluate_models(store, table, split, [], QUICK, out=tmp_path)
    written = report.stat().st_mtime_ns
    second, again = evaluate_models(store, table, split, [], QUICK, out=tmp_path)
    assert again.stat().st_mtime_ns == written
    assert [evaluation.model for evaluation in second] == [evaluation.model for evaluation in first]
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.metrics["mee"], other.metrics["mee"])
    report.unlink()
    evaluate_models(store, table, split, [], QUICK, out=tmp_path)
    assert report.is_file()
    with pytest.raises(InputError, match="another seed, config"):
        evaluate_models(store, table, split, [], EvaluationConfig(pictures=False, seed=1), out=tmp_path)


def test_missing_model_leaves_nothing(store, samples, tmp_path):
    with pytest.raises(InputError, match="absent"):
        evaluate_models(store, *samples, [tmp_path / "absent"], QUICK, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_baseline_of_unknown_tissue_is_refused_unless_it_is_given_or_left_out(store, samples, tmp_path):
    unknown = replace(store, scene={"simulator": "another"})
    with pytest.raises(InputError, match="constants of the tissue"):
        evaluate_models(unknown, *samples, [], QUICK, out=tmp_path / "a")
    assert not (tmp_path / "a").exists()
    given, _ = evaluate_models(unknown, *samples, [], QUICK, out=tmp_path / "b", materials=store.materials())
    known, _ = evaluate_models(store, *samples, [], QUICK, out=tmp_path / "c")
    np.testing.assert_array_equal(given[1].metrics["mee"], known[1].metrics["mee"])
    left_out, _ = evaluate_models(unknown, *samples, [], replace(QUICK, prior=False), out=tmp_path / "d")
    assert len(left_out) == 1


def test_constants_in_words():
    # E = 25.4 kPa and ν = 0.45 have μ = E / 2.9 and λ = E · 0.45 / 0.145.
    told = constants(StableNeoHookean.from_young(25.4e-3, 0.45))
    assert "μ = 8.758621 kPa" in told
    assert "λ = 78.827586 kPa" in told
    assert "E = 25.4 kPa, ν = 0.45" in told
