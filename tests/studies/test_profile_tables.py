import numpy as np
import pytest

from mixpinn.studies.profile_tables import cost_figure, depth_figure, exponent, exponent_table, profile_table


def rows(power=1.5, slope=0.0):
    """Times of one method that follow t = n^power · (1 + slope · (depth − 1)) exactly."""
    found = []
    for name, nodes in (("small", 1000), ("paper", 8000), ("large", 27000)):
        base = nodes**power * 1e-4
        by_depth = {f"{depth:g}": base * (1.0 + slope * (depth - 1)) for depth in range(1, 10)}
        median = float(np.median(list(by_depth.values())))
        found.append({
            "mesh": name, "nodes": nodes, "edges": 10 * nodes, "method": "row-10", "device": "cpu", "threads": 2,
            "repeats": 9, "mean_ms": median, "median_ms": median, "p95_ms": median, "peak_mb": 3.0,
            "by_depth_ms": by_depth,
        })
    return found


@pytest.mark.parametrize("power", [0.8, 1.0, 2.0])
def test_power_law_is_found_again(power):
    assert exponent_table(rows(power)).rows[0][1] == pytest.approx(power)


def test_one_size_has_no_exponent():
    assert exponent([5.0, 5.0], [1.0, 2.0]) is None


def test_growth_with_depth_is_told_and_its_absence_too():
    assert exponent_table(rows()).rows[0][2] == pytest.approx(1.0)
    # The middle of the deepest third is depth 8, that of the shallowest depth 2.
    assert exponent_table(rows(slope=0.5)).rows[0][2] == pytest.approx((1.0 + 0.5 * 7) / (1.0 + 0.5 * 1))


def test_paper_rows_are_quoted_below_the_measured_ones():
    table = profile_table(rows())
    assert [row[0] for row in table.rows] == ["Row 10 (MIXPINN)"] * 3 + ["FEM (SOFA) (paper)", "MIXPINN (paper)"]
    assert table.muted == {3, 4}
    assert table.rows[4][3] == 73.24


def test_pictures_show_the_mesh_nearest_the_papers(tmp_path):
    assert "paper" in depth_figure(rows()).axes[0].get_title(loc="left")
    line = cost_figure(rows()).axes[0].lines[0]
    np.testing.assert_allclose(line.get_xdata(), [1000, 8000, 27000])
