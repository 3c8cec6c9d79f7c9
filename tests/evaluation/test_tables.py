"""The tables hold what they should."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.dataset import DatasetTable
from mixpinn.evaluation import (
    AS_PUBLISHED,
    METRIC_LABELS,
    ablation_table,
    dataset_counts_table,
    depth_table,
    mesh_table,
    part_table,
    results_table,
    runtime_table,
    spread_table,
)
from mixpinn.records import Evaluation, TissueMesh


def test_results_hold_means_and_the_quoted_rows(evaluations: tuple[Evaluation, ...]) -> None:
    table = results_table(evaluations)
    assert table.columns == ("Model", *METRIC_LABELS.values())
    assert [row[0] for row in table.rows] == [
        "No motion", "Simple GAT", "MIXPINN", "PhysGNN (paper)", "Simple GAT (paper)", "MIXPINN (paper)",
    ]
    # MEE is 0.2 × depth + 0.1 × position: 0.2 × 3 + 0.1 × 1.5.
    assert table.rows[2][1:] == pytest.approx((0.75, 0.375, 0.1875, 0.6, 0.825, 0.0375))
    assert table.rows[5][1:] == (0.2588, 0.1304, 0.0670, 0.1663, 0.3126, 0.0326)
    assert table.muted == {3, 4, 5}
    assert len(results_table(evaluations, with_paper=False).rows) == 3


def test_as_published_takes_the_second_set_where_it_exists(evaluations: tuple[Evaluation, ...]) -> None:
    evaluations[2].metrics["mee" + AS_PUBLISHED] = np.full(20, 9.0)
    rows = results_table(evaluations, as_published=True).rows
    assert rows[2][1] == 9.0
    assert rows[1][1] == pytest.approx(evaluations[1].metrics["mee"].mean())
    assert results_table(evaluations).rows[2][1] == pytest.approx(0.75)


def test_results_name_the_discretisation_and_do_not_mix_two(evaluations: tuple[Evaluation, ...]) -> None:
    for evaluation in evaluations:
        evaluation.notes["discretisation"] = "linear tetrahedra, 8 nodes, mesh abc"
    assert "All on linear tetrahedra, 8 nodes, mesh abc." in results_table(evaluations).note
    evaluations[1].notes["discretisation"] = "quadratic tetrahedra, 27 nodes, mesh def"
    with pytest.raises(InputError, match=r"one discretisation, got .* linear .* quadratic"):
        results_table(evaluations)


def test_missing_metrics_are_gaps(evaluations: tuple[Evaluation, ...]) -> None:
    del evaluations[0].metrics["ree"]
    assert results_table(evaluations).rows[0][-1] is None


def test_spread_has_a_row_for_each_model_and_metric(evaluations: tuple[Evaluation, ...]) -> None:
    table = spread_table(evaluations, generator=np.random.default_rng(0))
    assert len(table.rows) == 3 * 6
    model, metric, mean, std, low, high, p95, worst = table.rows[12]
    assert (model, metric) == ("MIXPINN", "MEE [mm]")
    assert mean == pytest.approx(0.75)
    # Variances of 0.2 × (1 … 5) and 0.1 × (0 … 3) add up: 0.04 × 2 + 0.01 × 1.25.
    assert std == pytest.approx(np.sqrt(0.0925))
    assert low < mean < high < p95 <= worst
    assert worst == pytest.approx(1.3)


def test_depth_and_part_tables(evaluations: tuple[Evaluation, ...]) -> None:
    depths = depth_table(evaluations)
    assert [row[0] for row in depths.rows] == [1, 2, 3, 4, 5]
    assert [row[1] for row in depths.rows] == [4] * 5
    assert [row[4] for row in depths.rows] == pytest.approx([0.35, 0.55, 0.75, 0.95, 1.15])
    parts = part_table(evaluations)
    assert [row[0] for row in parts.rows] == ["Soft tissue", "L1"]
    assert parts.rows[1][3] == pytest.approx(0.6)


def test_runtime_in_milliseconds(evaluations: tuple[Evaluation, ...]) -> None:
    table = runtime_table(evaluations, fem_seconds=1.5)
    assert table.rows[2] == ("MIXPINN", pytest.approx(12.0), pytest.approx(12.0), pytest.approx(12.0), 2)
    assert table.rows[3][:2] == ("Finite elements, one step", 1500.0)
    assert table.rows[-1][:2] == ("MIXPINN (paper)", 73.24)


def test_ablation_sets_ours_beside_the_papers(evaluations: tuple[Evaluation, ...]) -> None:
    table = ablation_table({10: evaluations[2]})
    assert len(table.rows) == 13
    assert table.rows[9][:6] == (10, 2, "", "", "✓", "")
    assert table.rows[9][6] == pytest.approx(0.75)
    assert table.rows[9][-3:] == (0.2588, 0.1663, 0.0326)
    assert table.rows[0][6:12] == (None,) * 6


def test_mesh_table_counts_labels_by_the_both_ends_rule(two_cells: TissueMesh) -> None:
    table = mesh_table(two_cells)
    # Nine edges in all: 1-2 in A and 3-4 in B.
    assert table.rows == (("Soft tissue", 1, 14), ("A", 2, 2), ("B", 2, 2), ("Total", 5, 18))
    assert "2 tetrahedra, 1 fixed" in table.note


def test_dataset_table_shows_each_split() -> None:
    counts = DatasetTable("by position", (2, 1, 1, 4), (8, 4, 4, 16), (100, 50, 51, 201))
    table = dataset_counts_table(counts, with_paper=True)
    assert table.rows[0] == ("train", 2, 8, 100)
    assert table.rows[3] == ("total", 4, 16, 201)
    assert table.rows[-1] == ("total (paper)", 132, 528, 9796)
    assert table.muted == {4, 5, 6, 7}
