"""What benchmarks.truth and benchmarks.locking compute from solutions, and the loads of the linear study."""

from math import gamma

import numpy as np
import pytest

from benchmarks import locking, truth
from fem.block_mesh import block


def press(force: float, shift: float) -> truth.Press:
    return truth.Press(
        np.full(4, force), np.full((4, 1, 3), shift / np.sqrt(3.0)), np.full((4, 5, 3), shift / np.sqrt(3.0)),
        np.ones((4, 2)), 1.0,
    )


def test_errors_are_taken_from_the_extrapolated_solution():
    # Errors proportional to the edge: the lengths 14 and 7 find 10 N and 2 mm; 20 and 10 are 0.1 N and 0.02 mm off.
    found = {
        ("linear", 0): press(20.0, 3.0), ("quadratic", 0): press(14.0, 2.4),
        (truth.level_of(14.0), 0): press(11.4, 2.28), (truth.level_of(7.0), 0): press(10.7, 2.14),
        (truth.level_of(20.0), 0): press(12.1, 2.42), (truth.level_of(10.0), 0): press(11.1, 2.22),
        ("linear", 1): press(20.0, 3.0),  # no reference at this pose
    }
    result = truth.report(found, [20.0, 14.0, 10.0, 7.0], order=1.0, rest=None)
    assert result["poses"] == 1
    assert result["reference"] == truth.extrapolation_of(7.0)
    rows, uncertainty = result["rows"], result["uncertainty"]
    assert rows["quadratic"]["force"] == pytest.approx(0.4)
    assert rows["linear"]["force"] == pytest.approx(1.0)
    assert rows["quadratic"]["vertebra_mm"] == pytest.approx(0.4)
    assert rows["quadratic"]["vertebra_rel"] == pytest.approx(0.2)
    assert rows["quadratic"]["vertebra_bar"] == pytest.approx(0.4 / 0.05)
    assert rows["quadratic"]["field_mm"] == pytest.approx(0.4)
    assert rows[truth.level_of(7.0)]["force"] == pytest.approx(0.07)
    assert uncertainty["force"] == pytest.approx(0.01)
    assert uncertainty["field_mm"] == pytest.approx(0.02)


def test_what_cells_along_the_held_border_tend_to_belongs_to_the_reference():
    # Under the probe errors fall with the square of the edge: 14 and 7 find 10 N and 2 mm. Along the border they fall
    # with the edge: 12 and 6 mm take 1 N off and add 0.2 mm to what the mesh as it is finds, and 0.2 N stay for 6 mm.
    found = {
        (truth.level_of(14.0), 0): press(10.4, 2.08), (truth.level_of(7.0), 0): press(10.1, 2.02),
        (truth.level_of(20.0), 0): press(10.8, 2.16), (truth.border_of(20.0, 12.0), 0): press(10.2, 2.28),
        (truth.border_of(20.0, 6.0), 0): press(10.0, 2.32), (truth.rest_of(20.0), 0): press(9.9, 2.34),
        ("linear", 0): press(18.0, 3.2), (truth.default_of(), 0): press(9.18, 2.21),
    }
    result = truth.report(found, [20.0, 14.0, 7.0], order=2.0, rest=20.0)
    assert result["rows"]["linear"]["force"] == pytest.approx(1.0)
    assert result["rows"]["linear"]["vertebra_mm"] == pytest.approx(1.0)
    assert result["rows"][truth.default_of()]["force"] == pytest.approx(0.02)
    assert result["rows"][truth.default_of()]["vertebra_mm"] == pytest.approx(0.01)
    assert result["border"]["force"] == pytest.approx(1.0 / 9.0)
    assert result["border"]["vertebra_mm"] == pytest.approx(0.2)
    assert result["border_uncertainty"]["force"] == pytest.approx(0.2 / 9.0)
    assert result["halved"]["vertebra_mm"] == pytest.approx(0.02)
    assert result["uncertainty"]["force"] is None


def test_presses_survive_the_cache(tmp_path):
    assert truth.kept(tmp_path / "pose.npz") is None
    truth.keep(tmp_path / "pose.npz", press(3.0, 1.0))
    again = truth.kept(tmp_path / "pose.npz")
    np.testing.assert_array_equal(again.force, np.full(4, 3.0))
    assert again.seconds == 1.0


def test_presses_kept_before_they_said_whether_they_ended_are_whole(tmp_path):
    entries = vars(press(3.0, 1.0))
    np.savez(tmp_path / "pose.npz", **{name: entries[name] for name in entries if name != "ended"})
    assert truth.kept(tmp_path / "pose.npz").ended


@pytest.mark.parametrize("order", [1, 2])
def test_loads_of_the_linear_study_are_the_integral_of_the_pressure(order):
    mesh = block((10, 1, 8), size=(200.0, 20.0, 160.0))
    points = mesh.points - np.array([100.0, 0.0, 80.0])
    mesh = type(mesh)(points, mesh.cells, mesh.part, mesh.fixed, (), mesh.tissue).with_order(order)
    push, force = locking.loads(mesh)
    # ∫ exp(−(x/a)⁴) dx = 2 a Γ(5/4); the third pressure is centred at (0, 0), far from the rim.
    assert force[2] == pytest.approx(4.0 * 24.0 * 10.0 * gamma(1.25) ** 2, rel=1e-4)
    centre = (push[2][:, None] * mesh.node_points).sum(axis=0) / force[2]
    np.testing.assert_allclose(centre, [0.0, 20.0, 0.0], atol=1e-3)
