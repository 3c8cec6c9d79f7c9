"""What a budget says of any answer."""

from dataclasses import replace

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.records import Answer, Motion, Source
from mixpinn.records.error_budget import BudgetEntry, BudgetKind, ErrorBudget, TotalError
from training.toy_block import block_mesh


def budget(discretisation="linear tetrahedra"):
    entry = BudgetEntry(
        "discretisation", BudgetKind.ERROR, "linear → quadratic", 4.0, -0.4, {"L1": 0.5}, 0.25, 0.1, 2, "So.",
    )
    return ErrorBudget(
        "Toy", discretisation, 10.0, ((0.0, 1.0, 2.0), (1.0, 1.0, 2.0)), 10.0, {"L1": 2.0, "L2": 0.1}, (entry,), 4.0,
        {"L1": 0.5, "L2": 0.09}, "When the probe presses.", True,
    )


def test_saved_and_loaded_it_is_the_same(tmp_path):
    budget().save(tmp_path / "budget.json")
    assert ErrorBudget.load(tmp_path / "budget.json") == budget()
    (tmp_path / "budget.json").write_text("{}")
    with pytest.raises(InputError, match=r"budget\.json"):
        ErrorBudget.load(tmp_path / "budget.json")


def test_shares_of_errors_add_up_by_their_squares():
    assert budget().total == TotalError(0.4, 0.25, 10.0, 2)
    twice = replace(budget(), entries=2 * budget().entries)
    assert twice.total.force == pytest.approx(0.4 * 2**0.5)
    assert twice.total.motion == pytest.approx(0.25 * 2**0.5)


def test_one_line_scales_with_the_answer():
    total = TotalError(0.4, 0.25, 10.0, 2)
    line = total.describe(20.0, 3.0)
    assert "8 N (40 %)" in line
    assert "0.75 mm (25 %)" in line
    assert line.startswith("Against the converged solution")
    assert "N (" not in total.describe(None, 3.0)
    assert "120 N" in total.describe(300.0, None)


def test_an_answer_says_it_where_it_knows():
    mesh = block_mesh()
    motion = Motion(np.array([0.0, -3.0, 0.0]), np.zeros(3), np.eye(3))
    answer = Answer(
        mesh, np.zeros((mesh.n_points, 3)), Source.HYBRID_POSE, force=np.array([0.0, 20.0, 0.0]),
        motions={"L1": motion}, total=budget().total,
    )
    assert answer.describe()[-1] == budget().total.describe(20.0, 3.0)
    assert not any("converged solution" in line for line in Answer(mesh, answer.displacement, answer.source).describe())
