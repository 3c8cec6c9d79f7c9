"""The quoted figures hang together as the paper's text says."""

import pytest

from mixpinn.evaluation import PAPER_ABLATION, PAPER_DATASET, PAPER_MESH, PAPER_RESULTS, PAPER_RUNTIME


def test_ablation_has_thirteen_distinct_configurations() -> None:
    switches = {
        (row.heads, row.edge_features, row.rigid_edge_loss, row.virtual_nodes, row.virtual_edges)
        for row in PAPER_ABLATION
    }
    assert [row.experiment for row in PAPER_ABLATION] == list(range(1, 14))
    assert len(switches) == 13


def test_results_are_rows_of_the_ablation() -> None:
    named = {result.model: result for result in PAPER_RESULTS}
    for model, experiment in (("Simple GAT", 1), ("MIXPINN", 10)):
        row = PAPER_ABLATION[experiment - 1].result
        assert (row.mee, row.mae, row.mse, row.rigid_mee, row.soft_mee, row.ree) == (
            named[model].mee, named[model].mae, named[model].mse, named[model].rigid_mee, named[model].soft_mee,
            named[model].ree,
        )


def test_mixpinn_is_best_but_for_rigid_edges() -> None:
    best = min(PAPER_ABLATION, key=lambda row: row.result.mee)
    assert best.experiment == 10
    assert min(PAPER_ABLATION, key=lambda row: row.result.ree).experiment == 7


def test_overall_error_is_the_mean_over_rigid_and_soft_nodes() -> None:
    """5,533 soft and 3,213 rigid nodes, the paper's mesh, weigh the two parts; virtual nodes change little."""
    for row in PAPER_ABLATION:
        expected = (5533 * row.result.soft_mee + 3213 * row.result.rigid_mee) / 8746
        assert row.result.mee == pytest.approx(expected, abs=4e-4)


def test_counts_add_up() -> None:
    assert sum(points for _, points, _ in PAPER_MESH[:-1]) == PAPER_MESH[-1][1]
    assert sum(edges for _, _, edges in PAPER_MESH[:-1]) == PAPER_MESH[-1][2]
    for column in (1, 2, 3):
        assert sum(row[column] for row in PAPER_DATASET[:-1]) == PAPER_DATASET[-1][column]
    assert PAPER_RUNTIME["FEM (SOFA)"] / PAPER_RUNTIME["MIXPINN"] > 10.0
