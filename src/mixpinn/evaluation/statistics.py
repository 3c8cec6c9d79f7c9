"""Statistics over samples: mean with spread and bootstrap interval, by depth and by part."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records import Evaluation


@dataclass(frozen=True)
class Summary:
    """One metric over the samples of a split; every value in the metric's unit.

    Attributes:
        mean: over samples.
        std: standard deviation over samples (divisor N).
        low, high: 95 % bootstrap interval of the mean, over probe positions.
        p95: 95th percentile of the samples.
        maximum: worst sample.
        n_samples, n_positions: what it is made from.
    """

    mean: float
    std: float
    low: float
    high: float
    p95: float
    maximum: float
    n_samples: int
    n_positions: int


@dataclass(frozen=True, eq=False)
class DepthProfile:
    """A metric against indentation depth, in bins of 1 mm; every array has shape (b,).

    Attributes:
        depth: centre of each bin [mm].
        mean, median, lower, upper: mean, median and quartiles of the samples in the bin, in the metric's unit.
        count: samples in the bin.
    """

    depth: FloatArray
    mean: FloatArray
    median: FloatArray
    lower: FloatArray
    upper: FloatArray
    count: IntArray


def bootstrap_interval(
    values: AnyArray, groups: AnyArray, *, generator: np.random.Generator, n_resamples: int = 2000, level: float = 0.95,
) -> tuple[float, float]:
    """Percentile interval of the mean over samples when whole groups are drawn with replacement.

    Steps and rotations of one probe position are correlated, so positions and not samples are what is drawn.

    Args:
        values: of each sample, shape (N,).
        groups: label of each sample's group (its position), shape (N,).
        generator: source of the draws.
        n_resamples: number of draws.
        level: coverage of the interval.

    Raises:
        InputError: no values, or another number of groups.
    """
    values, groups = np.asarray(values, dtype=np.float64), np.asarray(groups)
    if not len(values) or len(values) != len(groups):
        raise InputError(
            "bootstrap", expected="as many group labels as values, at least one",
            got=f"{len(groups)} labels and {len(values)} values", fix="pass one label a sample",
        )
    _, member = np.unique(groups, return_inverse=True)
    # Deviations from the overall mean are summed, so that equal values give an interval of exactly no width.
    centre = values.mean()
    total, count = np.bincount(member, weights=values - centre), np.bincount(member)
    drawn = generator.integers(len(count), size=(n_resamples, len(count)))
    # Mean over the samples of the drawn groups: Σ_g total_g / Σ_g count_g
    means = centre + total[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return float(low), float(high)


def summarise(
    values: AnyArray, positions: AnyArray, *, generator: np.random.Generator, n_resamples: int = 2000,
) -> Summary:
    """Summary of a metric.

    Args:
        values: of each sample, shape (N,).
        positions: probe position of each sample, shape (N,).
        generator: for the bootstrap.
        n_resamples: of the bootstrap.

    Raises:
        InputError: no values.
    """
    low, high = bootstrap_interval(values, positions, generator=generator, n_resamples=n_resamples)
    return Summary(
        mean=float(np.mean(values)), std=float(np.std(values)), low=low, high=high,
        p95=float(np.quantile(values, 0.95)), maximum=float(np.max(values)), n_samples=len(values),
        n_positions=len(np.unique(positions)),
    )


def summarise_metrics(evaluation: Evaluation, *, generator: np.random.Generator) -> dict[str, Summary]:
    """Summary of every metric of a model by name."""
    positions = evaluation.about["position"]
    return {name: summarise(values, positions, generator=generator) for name, values in evaluation.metrics.items()}


def summarise_parts(evaluation: Evaluation, *, generator: np.random.Generator) -> dict[str, Summary]:
    """Summary of the MEE of the soft tissue and of each rigid part by name [mm]."""
    positions = evaluation.about["position"]
    return {name: summarise(values, positions, generator=generator) for name, values in evaluation.by_part.items()}


def depth_profile(evaluation: Evaluation, *, metric: str = "mee") -> DepthProfile:
    """`metric` against indentation depth in bins of 1 mm, centred on whole millimetres; empty bins are left out."""
    values, bins = evaluation.metrics[metric], np.floor(evaluation.about["depth"] + 0.5)
    depths = np.unique(bins)
    chosen = [values[bins == depth] for depth in depths]
    lower, median, upper = np.array([np.quantile(value, [0.25, 0.5, 0.75]) for value in chosen]).T
    return DepthProfile(
        depths, np.array([value.mean() for value in chosen]), median, lower, upper,
        np.array([len(value) for value in chosen]),
    )


def typical_sample(evaluation: Evaluation) -> int:
    """Index of the sample to show in pictures: of those at the greatest depth the one with the median error."""
    depth, error = evaluation.about["depth"], evaluation.metrics["mee"]
    deepest = np.flatnonzero(depth > depth.max() - 0.5)
    return int(deepest[np.argsort(error[deepest], kind="stable")[len(deepest) // 2]])
