import numpy as np
import pytest

from mixpinn.evaluation import PAPER_ABLATION
from mixpinn.records import Evaluation
from mixpinn.studies.ablation_plots import ablation_bars, data_need_curve, hold_out_bars
from mixpinn.studies.ablation_tables import (
    REL_PAIRS,
    VIRTUAL_PAIRS,
    AblationRun,
    by_row,
    claims_table,
    data_need_table,
    hold_out_table,
    over_seeds,
    paper_table,
)
from mixpinn.studies.ablation_tables import test_set_table as one_set

POSITIONS = np.repeat([0.0, 1.0, 2.0], 2)


def evaluation(row, mee, *, rigid=None, ree=0.05, name="test"):
    """Six samples whose mean error is `mee`, at three positions."""
    shape = mee * np.array([0.5, 0.7, 0.8, 1.0, 1.4, 1.6])
    metrics = {"mee": shape, "rigid_mee": np.full(6, mee if rigid is None else rigid), "ree": np.full(6, ree)}
    about = {"position": POSITIONS, "rotation": np.zeros(6), "depth": np.ones(6)}
    return Evaluation(row, name, metrics, about, {}, np.full(6, 0.01))


def run(row, mee, *, seed=0, positions=None, rigid=None, ree=0.05, samples=10):
    sets = {name: evaluation(row, mee * factor, rigid=rigid, ree=ree, name=name) for name, factor in
            (("test", 1.0), ("deep", 3.0))}
    return AblationRun(row, seed, positions, sets, {"samples": samples, "epochs": 4})


@pytest.fixture
def runs():
    return (
        AblationRun("no-motion", None, None, {"test": evaluation("no-motion", 1.0)}),
        run("row-2", 0.4, rigid=0.4), run("row-10", 0.2, rigid=0.1, seed=0), run("row-10", 0.4, rigid=0.3, seed=1),
        run("row-9", 0.4, ree=0.08), run("physgnn", 0.6), run("row-10", 0.5, positions=12, samples=5),
    )


def test_seeds_are_averaged_and_their_spread_told(runs):
    mean, spread = over_seeds(by_row(runs)["row-10"], "test", "mee")
    assert mean == pytest.approx(0.3)
    assert spread == pytest.approx(np.sqrt(2 * 0.1**2))
    assert over_seeds(by_row(runs)["row-2"], "test", "mee") == (pytest.approx(0.4), None)
    assert over_seeds([], "test", "mee") is None


def test_runs_with_few_positions_stand_in_the_data_need_table_alone(runs):
    table = one_set(runs, "test", title="t", note="n", seed=0)
    row = {row[0]: row for row in table.rows}["Row 10 (MIXPINN)"]
    assert row[2] == 2
    assert row[3] == pytest.approx(0.3)
    need = data_need_table(runs, "test", all_positions=93)
    assert [(row[0], row[1], row[3]) for row in need.rows] == [
        (12, 5, pytest.approx(0.5)), (93, 10, pytest.approx(0.2)),
    ]
    assert data_need_table(runs[:3], "test", all_positions=93) is None


def test_interval_covers_the_mean_and_knows_positions(runs):
    row = one_set(runs, "test", title="t", note="n", seed=0).rows[-1]
    low, high = row[-2:]
    # The means of the three positions are 0.6, 0.9 and 1.5 of it, and no draw leaves their range.
    assert 0.6 * row[3] <= low + 1e-9 < row[3] < high <= 1.5 * row[3] + 1e-9


def test_baselines_count_no_seed_and_missing_metrics_are_dashes(runs):
    row = one_set(runs, "test", title="t", note="n", seed=0).rows[0]
    assert row[:3] == ("No motion", "", None)
    assert row[4] is None  # MAE, which these evaluations do not have
    found = {row[0]: row for row in hold_out_table(runs, ["test", "deep"]).rows}
    assert found["No motion"][3] is None
    assert found["PhysGNN"][2:] == (pytest.approx(0.6), pytest.approx(1.8))


def test_pairs_differ_by_what_their_claim_names_alone():
    rows = {entry.experiment: entry for entry in PAPER_ABLATION}
    names = ("heads", "edge_features", "rigid_edge_loss", "virtual_nodes", "virtual_edges")

    def changed(a, b):
        return {name for name in names if getattr(rows[a], name) != getattr(rows[b], name)}

    assert len(VIRTUAL_PAIRS) == 8
    for without, with_virtual, kind in VIRTUAL_PAIRS:
        assert changed(without, with_virtual) == {{"VN": "virtual_nodes", "VE": "virtual_edges"}[kind]}
        assert getattr(rows[with_virtual], {"VN": "virtual_nodes", "VE": "virtual_edges"}[kind])
    assert len(REL_PAIRS) == 6
    for without, with_rel in REL_PAIRS:
        assert changed(without, with_rel) == {"rigid_edge_loss"}
        assert rows[with_rel].rigid_edge_loss


def test_claims_are_judged_by_their_bars(runs):
    rows = {row[0] + row[1]: row for row in claims_table(runs, "test").rows}
    virtual = rows["VN lowers rigid MEE2 → 10"]
    assert virtual[4] == pytest.approx(0.4 / 0.1)  # over the seed that both rows have
    assert virtual[7] == 1
    assert virtual[5] == pytest.approx(0.3456 / 0.1663)
    assert virtual[6] == "yes"
    assert rows["REL lowers REE2 → 9"][6] == "no"
    last = next(row for row in claims_table(runs, "test").rows if row[0] == "PhysGNN is last")
    assert (last[2], last[3], last[6]) == (pytest.approx(0.6), pytest.approx(0.4), "yes")
    weak = claims_table((run("row-2", 0.4, rigid=0.14), run("row-10", 0.2, rigid=0.1)), "test").rows
    assert [row[6] for row in weak] == ["no"]  # 1.4 is below the bar of 1.5


def test_papers_rows_stand_beside_ours_where_we_have_none(runs):
    rows = {row[0]: row for row in paper_table(runs, "test").rows}
    assert rows["Row 13"][2:6] == (None, None, None, None)
    assert rows["Row 13"][6] == 0.2830
    assert rows["No motion"][6] is None


def test_pictures_draw_every_row_and_seed(runs):
    figure = ablation_bars(runs, "test")
    panel = figure.axes[0]
    assert len(panel.patches) == len(by_row(runs))
    dots = [line.get_xdata() for line in panel.lines if len(line.get_xdata()) == 2 and line.get_marker() == "."]
    np.testing.assert_allclose(dots[0], [0.2, 0.4])
    assert len(hold_out_bars(runs, ["test", "deep"], rows=("row-2", "physgnn")).axes[0].patches) == 4
    curve = data_need_curve(runs, "test", all_positions=93).axes[0].lines[0]
    np.testing.assert_allclose(curve.get_xdata(), [12, 93])
    np.testing.assert_allclose(curve.get_ydata(), [0.5, 0.2])
