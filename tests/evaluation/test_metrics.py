"""Metrics against figures worked out by hand, and their invariances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mixpinn.base.errors import InputError
from mixpinn.evaluation import (
    MetricGeometry,
    VirtualTopology,
    errors_by_part,
    mean_absolute_error,
    mean_euclidean_error,
    mean_squared_error,
    rigid_edge_error,
    sample_metrics,
    virtual_reference,
)
from mixpinn.records import TissueMesh

# Errors of the five nodes by hand: lengths 0, 5, 1, 13 and 2.
DIFFERENCE = np.array([[0.0, 0, 0], [3, -4, 0], [0, 0, -1], [3, 4, 12], [-2, 0, 0]])
REFERENCE = np.array([[0.1, 0.2, 0.3]] * 5)


def test_metrics_by_hand(two_cells: TissueMesh) -> None:
    values = sample_metrics(REFERENCE + DIFFERENCE, REFERENCE, MetricGeometry.of(two_cells))
    assert values["mee"] == pytest.approx((0 + 5 + 1 + 13 + 2) / 5)
    assert values["mae"] == pytest.approx((3 + 4 + 1 + 3 + 4 + 12 + 2) / 15)
    assert values["mse"] == pytest.approx((9 + 16 + 1 + 9 + 16 + 144 + 4) / 15)
    assert values["rigid_mee"] == pytest.approx((5 + 1 + 13 + 2) / 4)
    assert values["soft_mee"] == pytest.approx(0.0)
    # Edge 1-2 is (-3, 4, 0), stretched by (-3, 4, -1); edge 3-4 is (3, 4, 0), stretched by (-5, -4, -12).
    first = abs(math.dist((0, 0, 0), (-6, 8, -1)) - 5.0)
    second = abs(math.dist((0, 0, 0), (-2, 0, -12)) - 5.0)
    assert values["ree"] == pytest.approx((first + second) / 2)


def test_errors_by_part(two_cells: TissueMesh) -> None:
    values = errors_by_part(REFERENCE + DIFFERENCE, REFERENCE, MetricGeometry.of(two_cells))
    assert values == pytest.approx({"soft": 0.0, "vertebrae_A": 3.0, "vertebrae_B": 7.5})


def test_virtual_nodes_and_edges_are_counted(two_cells: TissueMesh, virtual: VirtualTopology) -> None:
    geometry = MetricGeometry.of(two_cells)
    target = virtual_reference(DIFFERENCE, geometry, virtual)
    assert target[5:] == pytest.approx(np.array([[1.5, -2.0, -0.5], [0.5, 2.0, 6.0]]))
    predicted = np.zeros((7, 3))
    values = sample_metrics(predicted, target, geometry.with_virtual(virtual))
    lengths = [0, 5, 1, 13, 2, math.sqrt(1.5**2 + 2**2 + 0.5**2), math.sqrt(0.5**2 + 2**2 + 6**2)]
    assert values["mee"] == pytest.approx(sum(lengths) / 7)
    assert values["rigid_mee"] == pytest.approx(sum(lengths[1:]) / 6)
    assert values["ree"] == 0.0
    # Only the first virtual node moves, by 1 mm along z: its two edges of 2.5 mm grow to √(2.5² + 1²).
    predicted[5] = [0, 0, 1]
    values = sample_metrics(predicted, target, geometry.with_virtual(virtual))
    assert values["ree"] == pytest.approx(2 * (math.sqrt(7.25) - 2.5) / 6)


def test_virtual_edges_without_virtual_nodes(two_cells: TissueMesh) -> None:
    only_edges = VirtualTopology(np.empty((0, 3)), np.empty(0, dtype=np.int64), np.array([[1, 4]]))
    geometry = MetricGeometry.of(two_cells)
    assert virtual_reference(REFERENCE, geometry, only_edges) == pytest.approx(REFERENCE)
    assert len(geometry.with_virtual(only_edges).rigid_edges) == 3


def test_batches_are_vectorised() -> None:
    generator = np.random.default_rng(0)
    predicted, reference = generator.normal(size=(2, 4, 7, 3))
    for metric in (mean_euclidean_error, mean_absolute_error, mean_squared_error):
        one_by_one = [metric(p, r) for p, r in zip(predicted, reference, strict=True)]
        assert metric(predicted, reference) == pytest.approx(one_by_one)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1.0, 500.0))
def test_rigid_motion_has_no_rigid_edge_error(seed: int, scale: float) -> None:
    generator = np.random.default_rng(seed)
    points = scale * generator.uniform(-1.0, 1.0, size=(30, 3))
    rotation, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    displacement = points @ rotation.T + generator.normal(size=3) - points
    edges = np.array([[i, j] for i in range(30) for j in range(i)])
    assert rigid_edge_error(displacement, points, edges) < 1e-12 * max(1.0, scale / 10.0)


@given(st.floats(-0.5, 3.0))
def test_stretch_changes_each_edge_by_its_length(stretch: float) -> None:
    points = np.array([[0.0, 0, 0], [3, 4, 0], [3, 4, 12]])
    # A uniform stretch by 1 + s makes edges of 5 and 12 mm longer by 5 s and 12 s.
    error = rigid_edge_error(stretch * points, points, np.array([[0, 1], [2, 1]]))
    assert error == pytest.approx(8.5 * abs(stretch), abs=1e-12)


def test_directed_and_undirected_edges_agree(two_cells: TissueMesh) -> None:
    edges = MetricGeometry.of(two_cells).rigid_edges
    both = np.concatenate([edges, edges[:, ::-1]])
    once, twice = (rigid_edge_error(DIFFERENCE, two_cells.points, e) for e in (edges, both))
    assert once == pytest.approx(float(twice))


def test_mesh_without_rigid_parts_has_no_rigid_metrics(two_cells: TissueMesh) -> None:
    soft = MetricGeometry(two_cells.points, np.zeros(5, dtype=np.int64), np.empty((0, 2), dtype=np.int64), ())
    values = sample_metrics(REFERENCE + DIFFERENCE, REFERENCE, soft)
    assert set(values) == {"mee", "mae", "mse", "soft_mee"}
    assert values["soft_mee"] == values["mee"]


def test_bad_predictions_are_refused(two_cells: TissueMesh) -> None:
    geometry = MetricGeometry.of(two_cells)
    with pytest.raises(InputError, match="shape"):
        sample_metrics(np.zeros((4, 3)), REFERENCE, geometry)
    with pytest.raises(InputError, match="finite"):
        sample_metrics(np.full((5, 3), np.nan), REFERENCE, geometry)
