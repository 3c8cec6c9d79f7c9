"""The training loop: it learns, survives interruption anywhere, keeps the best weights, spreads over processes."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.multiprocessing.spawn import ProcessRaisedException

from mixpinn.base.errors import InputError, MixpinnError, SolveError
from mixpinn.graph import Scaling
from mixpinn.networks import ModelConfig, load_checkpoint, read_description
from mixpinn.networks.tensor_file import read_tensors
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.training import EpochRecord, TrainConfig, TrainingResult, loop, read_history, train
from mixpinn.training.objective import training_loss
from training.toy_block import TINY, block_table

FAST = TrainConfig(learning_rate=5e-3, max_epochs=6, threads=1, seed=3)
DROPOUT = ModelConfig(architecture="physgnn", hidden=6, virtual_nodes=True)
ROOT = Path(__file__).parents[2]


def curve(history: tuple[EpochRecord, ...]) -> list[tuple[float, ...]]:
    """The history without the wall time."""
    return [(record.epoch, record.train_loss, record.validation_loss, record.learning_rate) for record in history]


@pytest.fixture
def run(mesh: TissueMesh, table: SampleTable, validation: SampleTable) -> Any:
    """`train` on the toy problem."""
    def run(
        out: Path, config: TrainConfig = FAST, model: ModelConfig = TINY, *, train_on: SampleTable = table,
        validate_on: SampleTable = validation, devices: int = 1,
    ) -> TrainingResult:
        return train(
            model, config, mesh=mesh, table_train=train_on, table_validation=validate_on, out=out, devices=devices,
            accelerator="cpu",
        )
    return run


def test_one_sample_is_learnt_by_heart(run: Any, mesh: TissueMesh, tmp_path: Path) -> None:
    sample = block_table(mesh, 1)
    config = TrainConfig(learning_rate=0.01, max_epochs=150, threads=1, decay_patience=20, stop_patience=100)
    model = ModelConfig(layers=2, heads=2, hidden=32, virtual_nodes=True, scaling=Scaling.STANDARD)
    result = run(tmp_path, config, model, train_on=sample, validate_on=sample)
    at_rest = np.linalg.norm(sample.displacement[0], axis=1).mean()
    assert result.best_validation_loss < 0.2 * at_rest
    assert result.history[9].train_loss < result.history[0].train_loss


def test_the_weights_kept_are_those_of_the_best_epoch(
    run: Any, tmp_path: Path, mesh: TissueMesh, validation: SampleTable,
) -> None:
    # A learning rate this high makes the validation loss go up and down.
    result = run(tmp_path, replace(FAST, learning_rate=0.05, max_epochs=8))
    losses = [record.validation_loss for record in result.history]
    assert result.best_epoch - 1 == int(np.argmin(losses))
    model, graph, config = load_checkpoint(tmp_path)
    fields = torch.from_numpy(np.stack([validation.contact_field(i) for i in range(len(validation))]))
    target = torch.from_numpy(validation.displacement)
    means = [target[:, mesh.part == k].mean(dim=1, keepdim=True) for k in (1, 2)]
    with torch.no_grad():
        loss = training_loss(config, graph, model(fields), torch.cat([target, *means], dim=1))
    assert float(loss) == pytest.approx(result.best_validation_loss, rel=1e-5)
    summary = read_description(tmp_path)["training"]
    assert (summary["best_epoch"], summary["epochs"], summary["stopped_by"]) == (result.best_epoch, 8, "epoch limit")


def test_a_run_follows_from_its_seed_and_leaves_the_callers_random_numbers_alone(run: Any, tmp_path: Path) -> None:
    config = replace(FAST, max_epochs=2)
    torch.manual_seed(5)
    before = torch.get_rng_state()
    first = run(tmp_path / "a", config, DROPOUT)
    assert torch.equal(torch.get_rng_state(), before)
    torch.rand(7)
    assert curve(run(tmp_path / "b", config, DROPOUT).history) == curve(first.history)
    assert curve(run(tmp_path / "c", replace(config, seed=4), DROPOUT).history) != curve(first.history)


@pytest.mark.parametrize("model", [TINY, DROPOUT], ids=["gat", "physgnn"])
@pytest.mark.parametrize("killed_at", [5, 6, 9])
def test_a_run_killed_within_an_epoch_goes_on_to_the_same_curve(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: ModelConfig, killed_at: int,
) -> None:
    config = replace(FAST, max_epochs=5, decay_patience=1)  # the learning rate is part of what must go on
    whole = run(tmp_path / "whole", config, model)
    seen = 0
    original = loop.training_loss

    def dying(*arguments: Any) -> torch.Tensor:
        nonlocal seen
        seen += 1
        if seen == killed_at:  # four losses an epoch: three batches and one of validation
            raise KeyboardInterrupt
        return original(*arguments)

    monkeypatch.setattr(loop, "training_loss", dying)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "cut", config, model)
    monkeypatch.undo()
    assert len(read_history(tmp_path / "cut")) == (killed_at - 1) // 4
    resumed = run(tmp_path / "cut", config, model)
    assert curve(resumed.history) == curve(whole.history)
    first, second = (read_tensors(tmp_path / name / "weights.safetensors")[0] for name in ("whole", "cut"))
    assert all(torch.equal(first[name], second[name]) for name in first)


KILLED = """
import os, signal, sys
from pathlib import Path
from mixpinn.training import TrainConfig, loop, train
from training.toy_block import TINY, block_mesh, block_table
mesh = block_mesh()
save, epochs = loop.save_state, 0
def killing(*arguments, **settings):
    # Dies after the second epoch's weights are written and before its state is.
    global epochs
    epochs += 1
    if epochs == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    save(*arguments, **settings)
loop.save_state = killing
config = TrainConfig(learning_rate=5e-3, max_epochs=6, threads=1, seed=3)
train(TINY, config, mesh=mesh, table_train=block_table(mesh, 10), table_validation=block_table(mesh, 3, seed=1),
      out=Path(sys.argv[1]), accelerator="cpu")
"""


def test_a_process_killed_between_two_files_of_an_epoch_goes_on_to_the_same_curve(run: Any, tmp_path: Path) -> None:
    paths = os.pathsep.join([str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path / "cut")], env=environment, capture_output=True, timeout=120,
    )
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    assert len(read_history(tmp_path / "cut")) == 1
    # Two processes are compared here: on some CPUs their matrix products differ in the last digits, which six epochs of
    # training enlarge. A run that lost its optimizer's state would differ by a tenth.
    resumed, whole = curve(run(tmp_path / "cut").history), curve(run(tmp_path / "whole").history)
    assert [(epoch, rate) for epoch, _, _, rate in resumed] == [(epoch, rate) for epoch, _, _, rate in whole]
    assert np.array(resumed) == pytest.approx(np.array(whole), rel=1e-3)


def test_a_finished_run_is_extended_by_a_higher_limit_and_else_left_alone(run: Any, tmp_path: Path) -> None:
    whole = run(tmp_path / "whole")
    half = run(tmp_path / "half", replace(FAST, max_epochs=3))
    assert curve(half.history) == curve(whole.history)[:3]
    assert run(tmp_path / "half", replace(FAST, max_epochs=3)).history == half.history
    assert curve(run(tmp_path / "half").history) == curve(whole.history)


def test_the_time_budget_stops_after_the_epoch_that_exceeds_it(
    run: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    result = run(tmp_path, replace(FAST, time_budget=1e-6))
    assert (len(result.history), result.stopped_by) == (1, "time budget")
    assert "after epoch 1 (time budget)" in capsys.readouterr().err
    longer = run(tmp_path, replace(FAST, time_budget=result.seconds + 1e-6))
    assert len(longer.history) == 2


def test_scripted_losses_decay_and_stop_the_real_loop(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    script: Iterator[float] = iter([3.0, 2.0, *[2.5] * 30])
    monkeypatch.setattr(loop, "_validate", lambda *_: next(script))
    result = run(tmp_path, TrainConfig(threads=1))
    assert (result.stopped_by, len(result.history), result.best_epoch) == ("early stop", 17, 2)
    rates = [record.learning_rate for record in result.history]
    assert rates == pytest.approx([5e-4] * 7 + [5e-5] * 5 + [5e-6] * 5)
    assert all(later <= earlier for earlier, later in pairwise(rates))


def test_a_loss_that_is_no_number_ends_the_run_with_a_reason(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(loop, "_validate", lambda *_: float("nan"))
    with pytest.raises(SolveError, match="diverged in epoch 1"):
        run(tmp_path)
    assert not (tmp_path / "weights.safetensors").exists()


def test_another_runs_folder_is_refused(run: Any, tmp_path: Path) -> None:
    run(tmp_path, replace(FAST, max_epochs=1))
    with pytest.raises(InputError, match="another model, mesh or setting"):
        run(tmp_path, replace(FAST, max_epochs=1, batch_size=2))
    with pytest.raises(InputError, match="devices"):
        run(tmp_path, devices=0)


def test_an_error_in_another_process_comes_back_as_one_line() -> None:
    class FailingFabric:
        def launch(self, function: object) -> None:
            trace = "\n\n-- Process 1 terminated with the following error:\nTraceback ...\n"
            raise ProcessRaisedException(trace + self.last, 1, 99)

    fabric: Any = FailingFabric()
    fabric.last = "mixpinn.base.errors.SolveError: training diverged in epoch 3: lower it\n"
    with pytest.raises(MixpinnError, match=r"^training diverged in epoch 3: lower it$"):
        loop._launch(fabric, None)  # type: ignore[arg-type]
    fabric.last = "RuntimeError: a defect\n"
    with pytest.raises(ProcessRaisedException):
        loop._launch(fabric, None)  # type: ignore[arg-type]


def test_two_processes_learn_what_one_learns(run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]))
    config = replace(FAST, max_epochs=2)
    two = run(tmp_path / "two", config, devices=2)
    one = run(tmp_path / "one", config)
    np.testing.assert_allclose(curve(two.history), curve(one.history), rtol=1e-4)
