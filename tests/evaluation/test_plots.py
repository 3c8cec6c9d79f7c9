"""Plots show the data that they are given, with units, and read training logs."""

from pathlib import Path

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.evaluation import (
    error_against_depth,
    error_by_part,
    error_distribution,
    figure_png,
    loss_curves,
    save_figure,
)
from mixpinn.evaluation.plots import COLOURS
from mixpinn.records import Evaluation

LOG = "epoch,train_loss,validation_loss,learning_rate,seconds\n1,2.0,2.5,5e-4,9\n2,1.0,1.5,5e-4,9\n3,0.9,1.4,5e-5,9\n"


def test_depth_plot_draws_the_median(evaluations: tuple[Evaluation, ...]) -> None:
    axes = error_against_depth(evaluations).axes[0]
    assert "[mm]" in axes.get_xlabel()
    assert "[mm]" in axes.get_ylabel()
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert set(lines) == {"No motion", "Simple GAT", "MIXPINN"}
    # At 1 mm the four positions give 0.2, 0.3, 0.4 and 0.5.
    assert lines["MIXPINN"].get_ydata()[0] == pytest.approx(0.35)
    assert lines["No motion"].get_color() not in COLOURS


def test_bars_are_means_from_zero(evaluations: tuple[Evaluation, ...]) -> None:
    axes = error_by_part(evaluations).axes[0]
    heights = sorted(bar.get_height() for bar in axes.patches)
    assert heights[0] == pytest.approx(0.6)
    assert axes.get_ylim()[0] == 0.0
    assert [label.get_text() for label in axes.get_xticklabels()] == ["Soft tissue", "L1"]


def test_distribution_marks_each_model(evaluations: tuple[Evaluation, ...]) -> None:
    axes = error_distribution(evaluations).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == [e.model for e in evaluations]
    medians = [line.get_xdata()[0] for line in axes.get_lines() if line.get_marker() == "o"]
    assert 10.0 ** medians[2] == pytest.approx(np.median(evaluations[2].metrics["mee"]))


def test_distribution_of_equal_values_is_drawn(evaluations: tuple[Evaluation, ...]) -> None:
    evaluations[0].metrics["mee"][:] = 1.0
    assert figure_png(error_distribution(evaluations[:1])).startswith(b"\x89PNG")


def test_loss_curves_keep_the_models_colours(tmp_path: Path) -> None:
    log = tmp_path / "history.csv"
    log.write_text(LOG)
    axes = loss_curves({"B": log}, models=["A", "B"]).axes[0]
    training, validation, drop = axes.get_lines()
    assert training.get_ydata().tolist() == [2.0, 1.0, 0.9]
    assert validation.get_ydata().tolist() == [2.5, 1.5, 1.4]
    assert validation.get_color() == COLOURS[1]
    assert list(drop.get_xdata()) == [3.0, 3.0]


@pytest.mark.parametrize(("text", "message"), [
    ("epoch,loss\n1,2\n", "columns"), ("epoch,train_loss,validation_loss,learning_rate\n", "at least one epoch"),
    ("epoch,train_loss,validation_loss,learning_rate\n1,a,b,c\n", "numbers"),
])
def test_unusable_logs_are_refused(tmp_path: Path, text: str, message: str) -> None:
    log = tmp_path / "log.csv"
    log.write_text(text)
    with pytest.raises(InputError, match=message):
        loss_curves({"m": log})


def test_absent_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        loss_curves({"m": tmp_path / "none.csv"})


def test_figures_are_written_in_the_format_of_the_suffix(tmp_path: Path, evaluations: tuple[Evaluation, ...]) -> None:
    figure = error_against_depth(evaluations)
    save_figure(figure, tmp_path / "plot.svg")
    save_figure(figure, tmp_path / "plot.png")
    assert "<svg" in (tmp_path / "plot.svg").read_text()
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plot.png", "plot.svg"]
