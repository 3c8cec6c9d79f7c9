"""Evaluation of models whose answers are known."""

from pathlib import Path

import numpy as np
import pytest

from mixpinn.base.arrays import Float32Array, IntArray
from mixpinn.base.errors import InputError
from mixpinn.evaluation import (
    AS_PUBLISHED,
    Candidate,
    VirtualCandidate,
    VirtualTopology,
    ZeroModel,
    evaluate,
)
from mixpinn.records import Evaluation, SampleTable, TissueMesh

N_NODES = 5
"""Nodes of the fixture `two_cells`."""


class Constant:
    """Predicts the same displacement of every node."""

    name = "constant"

    def __init__(self, step: tuple[float, float, float]) -> None:
        self.step, self.calls = step, 0

    def predict(self, nodes: IntArray, displacements: Float32Array) -> Float32Array:
        self.calls += 1
        return np.tile(np.array(self.step, dtype=np.float32), (N_NODES, 1))


class WithVirtual(Constant):
    """The same, with two virtual nodes."""

    def __init__(self, virtual: VirtualTopology) -> None:
        super().__init__((0.0, 0.0, 0.0))
        self.virtual = virtual

    def predict_with_virtual(self, nodes: IntArray, displacements: Float32Array) -> Float32Array:
        return np.zeros((N_NODES + 2, 3), dtype=np.float32)


def test_zero_model_measures_the_motion(table: SampleTable, two_cells: TissueMesh) -> None:
    result = evaluate(ZeroModel(two_cells.n_points), table, two_cells, split="test", notes={"protocol": "toy"})
    motion = np.linalg.norm(table.displacement.astype(np.float64), axis=2)
    assert result.metrics["mee"] == pytest.approx(motion.mean(axis=1))
    assert result.metrics["mean_displacement"] == pytest.approx(motion.mean(axis=1), rel=1e-6)
    assert result.metrics["largest_error"] == pytest.approx(motion.max(axis=1), rel=1e-6)
    assert result.by_part["vertebrae_A"] == pytest.approx(motion[:, 1:3].mean(axis=1))
    assert (result.metrics["ree"] == 0.0).all()
    assert result.about["position"].tolist() == [0, 0, 1, 1, 2, 2]
    assert result.notes["protocol"] == "toy"
    assert len(result.seconds) == 6
    assert (result.seconds >= 0.0).all()


def test_input_is_the_contact_displacement(table: SampleTable, two_cells: TissueMesh) -> None:
    class Echo:
        name = "echo"

        def predict(self, nodes: IntArray, displacements: Float32Array) -> Float32Array:
            field = np.zeros((N_NODES, 3), dtype=np.float32)
            field[nodes] = displacements
            return field

    result = evaluate(Echo(), table, two_cells, split="test")
    others = np.linalg.norm(table.displacement[:, :4].astype(np.float64), axis=2)
    assert result.metrics["mee"] == pytest.approx(others.sum(axis=1) / 5.0)


def test_warm_up_is_not_timed(table: SampleTable, two_cells: TissueMesh) -> None:
    model = Constant((1.0, 0.0, 0.0))
    assert len(evaluate(model, table, two_cells, split="test", warm_up=3).seconds) == 6
    assert model.calls == 9


def test_as_published_counts_virtual_nodes(
    table: SampleTable, two_cells: TissueMesh, virtual: VirtualTopology,
) -> None:
    model = WithVirtual(virtual)
    assert isinstance(model, VirtualCandidate)
    assert not isinstance(Constant((0, 0, 0)), VirtualCandidate)
    result = evaluate(model, table, two_cells, split="test")
    field = table.displacement.astype(np.float64)
    centres = np.stack([field[:, 1:3].mean(axis=1), field[:, 3:5].mean(axis=1)], axis=1)
    every = np.concatenate([field, centres], axis=1)
    assert result.metrics["mee" + AS_PUBLISHED] == pytest.approx(np.linalg.norm(every, axis=2).mean(axis=1))
    assert result.metrics["mee"] == pytest.approx(np.linalg.norm(field, axis=2).mean(axis=1))
    model.virtual = None
    assert "mee" + AS_PUBLISHED not in evaluate(model, table, two_cells, split="test").metrics


def test_evaluation_survives_its_file(tmp_path: Path, table: SampleTable, two_cells: TissueMesh) -> None:
    result = evaluate(ZeroModel(two_cells.n_points), table, two_cells, split="test")
    result.save(tmp_path / "evaluation.json")
    again = Evaluation.load(tmp_path / "evaluation.json")
    assert again.metrics.keys() == result.metrics.keys()
    assert all((again.metrics[name] == result.metrics[name]).all() for name in result.metrics)


def test_zero_model_is_a_candidate() -> None:
    assert isinstance(ZeroModel(5), Candidate)


def test_foreign_or_missing_samples_are_refused(table: SampleTable, two_cells: TissueMesh) -> None:
    with pytest.raises(InputError, match="at least one sample"):
        evaluate(ZeroModel(two_cells.n_points), table.at_positions(np.array([99])), two_cells, split="test")
    moved = TissueMesh(
        2.0 * two_cells.points, two_cells.cells, two_cells.part, two_cells.fixed, two_cells.rigid_names,
        two_cells.tissue,
    )
    with pytest.raises(InputError, match="samples of linear tetrahedra"):
        evaluate(ZeroModel(two_cells.n_points), table, moved, split="test")
