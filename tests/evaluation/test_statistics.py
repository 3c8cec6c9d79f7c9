"""Statistics of known samples, and the coverage of the bootstrap interval."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.evaluation import bootstrap_interval, depth_profile, summarise, summarise_parts, typical_sample
from mixpinn.records import Evaluation


def test_summary_of_known_values() -> None:
    values = np.arange(1.0, 6.0)
    summary = summarise(values, np.arange(5), generator=np.random.default_rng(0))
    assert (summary.mean, summary.maximum, summary.n_samples, summary.n_positions) == (3.0, 5.0, 5, 5)
    assert summary.std == pytest.approx(np.sqrt(2.0))
    assert summary.p95 == pytest.approx(4.8)
    assert summary.low < 3.0 < summary.high


def test_equal_positions_give_an_interval_without_width() -> None:
    values = np.tile([0.1, 0.2, 0.7], 6)
    low, high = bootstrap_interval(values, np.repeat(np.arange(6), 3), generator=np.random.default_rng(1))
    assert low == pytest.approx(1.0 / 3.0, abs=1e-15)
    assert high - low < 1e-15


def test_interval_covers_the_true_mean_of_correlated_samples() -> None:
    """Positions differ by a normal of unit variance, samples of one position are equal: about 95 % must cover."""
    generator = np.random.default_rng(2)
    positions = np.repeat(np.arange(40), 10)
    covered = 0
    for _ in range(300):
        low, high = bootstrap_interval(generator.normal(size=40)[positions], positions, generator=generator,
                                       n_resamples=400)
        covered += low < 0.0 < high
    # Three standard errors of a binomial of 300 draws about 0.95, and the bootstrap's known slight shortfall.
    assert 0.95 - 0.06 <= covered / 300 <= 0.95 + 0.038


def test_samples_of_one_position_do_not_narrow_the_interval() -> None:
    values = np.random.default_rng(3).normal(size=20)
    widths = []
    for repeats in (1, 50):
        low, high = bootstrap_interval(
            np.repeat(values, repeats), np.repeat(np.arange(20), repeats), generator=np.random.default_rng(4),
        )
        widths.append(high - low)
    assert widths[1] == pytest.approx(widths[0])


def test_interval_weighs_positions_by_their_samples() -> None:
    values, positions = np.array([0.0, 0.0, 0.0, 4.0]), np.array([7, 7, 7, 9])
    low, high = bootstrap_interval(values, positions, generator=np.random.default_rng(5))
    # Draws of two positions give means of 0 (both 7), 1 (one of each) and 4 (both 9).
    assert (low, high) == pytest.approx((0.0, 4.0))


def test_missing_labels_are_refused() -> None:
    with pytest.raises(InputError, match="group labels"):
        bootstrap_interval(np.ones(3), np.ones(2), generator=np.random.default_rng(0))
    with pytest.raises(InputError, match="group labels"):
        bootstrap_interval(np.empty(0), np.empty(0), generator=np.random.default_rng(0))


def test_depth_profile_bins_by_the_millimetre() -> None:
    about = {"position": np.zeros(5), "depth": np.array([0.6, 1.0, 1.49, 1.5, 4.0])}
    profile = depth_profile(
        Evaluation("m", "test", {"mee": np.array([1.0, 2.0, 6.0, 5.0, 7.0])}, about, {}, np.empty(0)),
    )
    assert profile.depth.tolist() == [1.0, 2.0, 4.0]
    assert profile.count.tolist() == [3, 1, 1]
    assert profile.mean.tolist() == [3.0, 5.0, 7.0]
    assert profile.median.tolist() == [2.0, 5.0, 7.0]
    assert (profile.lower[0], profile.upper[0]) == (1.5, 4.0)


def test_parts_are_summarised_by_name(evaluations: tuple[Evaluation, ...]) -> None:
    parts = summarise_parts(evaluations[2], generator=np.random.default_rng(0))
    # MEE is 0.2 × depth + 0.1 × position with means 3 and 1.5: 0.75, and 0.8 times that on L1.
    assert parts["vertebrae_L1"].mean == pytest.approx(0.8 * 0.75)
    assert parts["soft"].mean == pytest.approx(1.1 * 0.75)


def test_typical_sample_is_deep_and_median() -> None:
    about = {"position": np.zeros(5), "depth": np.array([1.0, 5.0, 5.0, 5.0, 2.0])}
    errors = {"mee": np.array([0.1, 0.9, 0.3, 0.5, 0.2])}
    assert typical_sample(Evaluation("m", "test", errors, about, {}, np.empty(0))) == 3
