"""Plots of an evaluation: error against depth, its distribution, its parts, and loss curves."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path
from mixpinn.evaluation.evaluate import ZeroModel
from mixpinn.evaluation.metrics import SOFT, part_label
from mixpinn.evaluation.statistics import depth_profile
from mixpinn.records import Evaluation

# Okabe and Ito (2008): distinguishable with every common colour-vision deficiency; yellow is left out, for print.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

PLOT_STYLE = {
    "font.family": "DejaVu Sans", "font.size": 10.0, "axes.titlesize": 11.0, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#555555",
    "axes.grid": True, "axes.axisbelow": True, "grid.color": "#e3e3e3", "grid.linewidth": 0.8, "legend.frameon": False,
    "xtick.color": "#333333", "ytick.color": "#333333", "figure.facecolor": "white", "savefig.facecolor": "white",
}
_LOSS_COLUMNS = ("epoch", "train_loss", "validation_loss", "learning_rate")


def error_against_depth(evaluations: Sequence[Evaluation]) -> Figure:
    """MEE against indentation depth: the median of each model in a band from the first to the third quartile."""
    figure, axes = new_figure()
    with rc_context(PLOT_STYLE):
        looks = _look(evaluation.model for evaluation in evaluations)
        for evaluation in evaluations:
            profile, (colour, marker) = depth_profile(evaluation), looks[evaluation.model]
            axes.fill_between(profile.depth, profile.lower, profile.upper, color=colour, alpha=0.18, linewidth=0)
            axes.plot(
                profile.depth, profile.median, color=colour, marker=marker, markersize=4, linewidth=1.8,
                label=evaluation.model,
            )
        positive = np.concatenate([evaluation.metrics["mee"] for evaluation in evaluations])
        _logarithmic_if_wide(axes, positive)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="Indentation depth [mm]", ylabel="Mean Euclidean error [mm]", title="Error against depth")
        axes.legend(title="Median, quartile band", ncols=2, fontsize=9)
    return figure


def error_distribution(evaluations: Sequence[Evaluation]) -> Figure:
    """Distribution of MEE over samples: one violin a model on a logarithmic axis, median and 95th percentile marked."""
    figure, axes = new_figure(height=1.2 + 0.75 * len(evaluations))
    with rc_context(PLOT_STYLE):
        shown = [np.log10(np.maximum(evaluation.metrics["mee"], 1e-9)) for evaluation in evaluations]
        places = np.arange(len(shown))[::-1]
        looks = _look(evaluation.model for evaluation in evaluations)
        for evaluation, place, values in zip(evaluations, places, shown, strict=True):
            colour = looks[evaluation.model][0]
            if np.ptp(values) > 0.0:
                violin = axes.violinplot(values, [place], orientation="horizontal", widths=0.8, showextrema=False)
                bodies: Any = violin["bodies"]
                bodies[0].set(facecolor=colour, alpha=0.35, edgecolor=colour)
            low, median, high, p95 = np.log10(np.quantile(10.0**values, [0.25, 0.5, 0.75, 0.95]))
            axes.plot([low, high], [place, place], color=colour, linewidth=5, solid_capstyle="butt")
            axes.plot(median, place, "o", color="white", markeredgecolor="#222222", markersize=6)
            axes.plot(p95, place, "|", color="#222222", markersize=14, markeredgewidth=1.6)
        axes.set_yticks(places, [evaluation.model for evaluation in evaluations])
        axes.grid(False, axis="y")
        low, high = axes.get_xlim()
        ticks = np.log10([m * 10.0**e for e in range(int(np.floor(low)), int(np.ceil(high)) + 1) for m in (1, 2, 5)])
        ticks = ticks[(ticks >= low) & (ticks <= high)]
        axes.set_xticks(ticks, [f"{10.0**tick:g}" for tick in ticks])
        axes.set(
            xlabel="Mean Euclidean error of a sample [mm]",
            title="Error distribution (dot: median, bar: quartiles, tick: 95th percentile)",
        )
    return figure


def error_by_part(evaluations: Sequence[Evaluation]) -> Figure:
    """Mean MEE of the soft tissue and of each rigid part: a group of bars a part, one bar a model."""
    names = list(dict.fromkeys(name for evaluation in evaluations for name in evaluation.by_part))
    figure, axes = new_figure()
    with rc_context(PLOT_STYLE):
        looks = _look(evaluation.model for evaluation in evaluations)
        width = 0.8 / max(1, len(evaluations))
        for index, evaluation in enumerate(evaluations):
            means = [float(np.mean(evaluation.by_part.get(name, np.array([np.nan])))) for name in names]
            places = np.arange(len(names)) + (index - (len(evaluations) - 1) / 2.0) * width
            axes.bar(places, means, 0.92 * width, color=looks[evaluation.model][0], label=evaluation.model)
        axes.set_xticks(np.arange(len(names)), [part_label(name) for name in names])
        axes.grid(False, axis="x")
        if SOFT in names and len(names) > 1:
            axes.axvline(names.index(SOFT) + 0.5, color="#999999", linewidth=1, linestyle=":")
        axes.set(ylabel="Mean Euclidean error [mm]", title="Error by part: soft tissue and rigid parts")
        axes.legend(fontsize=9, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.1))
    return figure


def loss_curves(logs: Mapping[str, Path | str], *, models: Sequence[str] = ()) -> Figure:
    """Training and validation loss of each model against the epoch; drops of the learning rate are dotted lines.

    Args:
        logs: name of a model to its CSV with columns ``epoch,train_loss,validation_loss,learning_rate``.
        models: names in the order of the other plots, so that a model keeps its colour.

    Raises:
        InputError: a log is absent or has other columns.
    """
    figure, axes = new_figure()
    with rc_context(PLOT_STYLE):
        losses = []
        looks = _look([*models, *logs])
        for name, path in logs.items():
            colour, marker = looks[name]
            epoch, train, validation, rate = _read_losses(Path(path))
            losses += [train, validation]
            axes.plot(epoch, train, "--", color=colour, linewidth=1.4, label=f"{name}, training")
            axes.plot(epoch, validation, color=colour, linewidth=2.0, marker=marker, markersize=3.5,
                      label=f"{name}, validation")
            for drop in epoch[1:][np.diff(rate) < 0.0]:
                axes.axvline(drop, color=colour, linewidth=0.9, linestyle=":")
        _logarithmic_if_wide(axes, np.concatenate(losses))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="Epoch", ylabel="Loss [mm]", title="Training")
        axes.legend(fontsize=9)
    return figure


def figure_png(figure: Figure, *, dpi: int = 160) -> bytes:
    """The figure as the bytes of a PNG."""
    buffer = io.BytesIO()
    with rc_context(PLOT_STYLE):
        figure.savefig(buffer, format="png", dpi=dpi, bbox_inches="tight")
    return buffer.getvalue()


def save_figure(figure: Figure, path: Path | str, *, dpi: int = 160) -> None:
    """Write the figure in the format of the suffix (``.png``, ``.svg``, ``.pdf``)."""
    with rc_context(PLOT_STYLE), atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=dpi, bbox_inches="tight")


def new_figure(*, height: float = 3.9) -> tuple[Figure, Axes]:
    """An empty figure of the plots' width in their style, and its axes."""
    with rc_context(PLOT_STYLE):
        figure = Figure(figsize=(7.2, height), layout="constrained")
        FigureCanvasAgg(figure)
        return figure, figure.add_subplot()


def _look(models: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Colour and marker of each model, the baseline without motion in grey."""
    learned = [name for name in dict.fromkeys(models) if name != ZeroModel.name]
    looks = {name: (COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)]) for i, name in enumerate(learned)}
    return {**looks, ZeroModel.name: ("#888888", ".")}


def _logarithmic_if_wide(axes: Axes, values: FloatArray) -> None:
    """Take a logarithmic axis where the positive values span more than a factor of twenty."""
    positive = values[np.isfinite(values) & (values > 0.0)]
    if not len(positive) or np.quantile(positive, 0.98) < 20.0 * np.quantile(positive, 0.02):
        axes.set_ylim(bottom=0.0)
        return
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _read_losses(path: Path) -> tuple[FloatArray, ...]:
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        columns = tuple(np.array([float(row[name]) for row in rows]) for name in _LOSS_COLUMNS)
    except FileNotFoundError as error:
        raise InputError(str(path), expected="a training log", got="no such file", fix="check the path") from error
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(
            str(path), expected="columns " + ",".join(_LOSS_COLUMNS) + " of numbers",
            got=f"{type(error).__name__} {error}", fix="use the CSV log that training wrote",
        ) from error
    if not rows:
        raise InputError(str(path), expected="at least one epoch", got="an empty log", fix="train for an epoch")
    return columns
