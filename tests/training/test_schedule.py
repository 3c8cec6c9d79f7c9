"""Plateau decay and early stop against scripted validation losses."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mixpinn.training import PAPER_TRAINING, Schedule

CONFIG = PAPER_TRAINING


def run(losses: list[float]) -> list[Schedule]:
    """The schedule before the first epoch and after each."""
    schedules = [Schedule.start(CONFIG)]
    for loss in losses:
        schedules.append(schedules[-1].after(loss, CONFIG))
    return schedules


def test_a_lasting_plateau_decays_after_five_and_ten_epochs_and_stops_after_fifteen() -> None:
    schedules = run([1.0] * 16)
    rates = [schedule.learning_rate for schedule in schedules]
    # The first epoch improves on nothing; the five that follow make the plateau.
    assert rates[:6] == [5e-4] * 6
    assert rates[6:11] == pytest.approx([5e-5] * 5)
    assert rates[11:16] == pytest.approx([5e-6] * 5)
    assert [schedule.exhausted(CONFIG) for schedule in schedules] == [False] * 16 + [True]


def test_an_improvement_restarts_both_counts() -> None:
    losses = [1.0, 1.1, 1.1, 1.1, 1.1, 0.9, 1.0, 1.0, 1.0, 1.0, 0.8]
    last = run(losses)[-1]
    assert last.learning_rate == 5e-4
    assert (last.epochs_on_plateau, last.epochs_since_best, last.best_loss, last.improved) == (0, 0, 0.8, True)


def test_an_equal_loss_is_no_improvement() -> None:
    assert not run([1.0, 1.0])[-1].improved


def test_the_learning_rate_does_not_fall_below_its_minimum() -> None:
    # 5e-4 · 0.1⁵ = 5e-9 would be lower.
    assert run([1.0] + [2.0] * 25)[-1].learning_rate == 1e-8
    assert run([1.0] + [2.0] * 60)[-1].learning_rate == 1e-8


def test_the_early_stop_counts_on_through_a_decay() -> None:
    schedules = run([1.0, *[2.0] * 14, 0.5, *[2.0] * 14])
    assert not any(schedule.exhausted(CONFIG) for schedule in schedules)
    assert schedules[-1].after(2.0, CONFIG).exhausted(CONFIG)


def test_a_loss_that_is_no_number_counts_as_no_improvement() -> None:
    last = run([1.0, math.nan])[-1]
    assert (last.best_loss, last.epochs_since_best, last.improved) == (1.0, 1, False)


@given(st.lists(st.floats(0.0, 2.0), max_size=40), st.integers(0, 40))
def test_replay_goes_on_from_any_point(losses: list[float], cut: int) -> None:
    whole = run(losses)[-1]
    start = Schedule.start(CONFIG)
    assert start.replay(losses[:cut], CONFIG).replay(losses[cut:], CONFIG) == whole
    assert 1e-8 <= whole.learning_rate <= 5e-4
    assert whole.best_loss == min(losses, default=math.inf)
