"""The training stage: samples in, a model folder out that explains itself and can be resumed."""

from collections.abc import Mapping
from pathlib import Path

from mixpinn.base.rundir import finish_run, start_run
from mixpinn.networks import ModelConfig
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.training.config import TrainConfig
from mixpinn.training.history import TrainingResult
from mixpinn.training.job import LIMITS, TrainingJob
from mixpinn.training.loop import Accelerator, train


def train_stage(
    out: Path | str, model_config: ModelConfig, train_config: TrainConfig, *, mesh: TissueMesh,
    table_train: SampleTable, table_validation: SampleTable, inputs: Mapping[str, Path | str] | None = None,
    devices: int = 1, accelerator: Accelerator = "auto",
) -> TrainingResult:
    """Train in the run directory `out`, which is the model folder too; a run begun there before continues.

    The limits (`max_epochs`, `time_budget`, `threads`) may differ between the sessions of a run: a finished one is
    extended by giving it more.

    Args:
        out: run directory: ``run.json``, the model (``weights.safetensors``, ``model.json``, ``mesh.vtu``),
            ``state.safetensors``, ``history.csv`` and ``tensorboard/``.
        model_config: the network.
        train_config: optimizer, schedule, limits.
        mesh: the mesh of the samples.
        table_train: training samples.
        table_validation: validation samples.
        inputs: files that the samples came from, for the record.
        devices: processes, each with a device of its own.
        accelerator: kind of device.

    Raises:
        InputError: samples of another mesh or none, or `out` holds another run.
        SolveError: the loss is not a number any more.

    Example:
        >>> from mixpinn.networks import MIXPINN
        >>> network, settings = MIXPINN.with_width("tiny"), TrainConfig(max_epochs=1, threads=1)
        >>> train, valid = table.at_positions([0, 1]), table.at_positions([2])
        >>> result = train_stage("runs/new", network, settings, mesh=mesh, table_train=train, table_validation=valid)
        >>> len(result.history)
        1
    """
    job = TrainingJob(model_config, train_config, mesh, table_train, table_validation, Path(out))
    start_run(out, "train", job.settings, inputs=inputs, seed=train_config.seed, input_hashes=job.input_hashes)
    result = train(
        model_config, train_config, mesh=mesh, table_train=table_train, table_validation=table_validation, out=out,
        devices=devices, accelerator=accelerator,
    )
    finish_run(out, {
        **{name: value for name, value in job.summary(result.history, result.stopped_by).items() if name != "settings"},
        "limits": {name: getattr(train_config, name) for name in LIMITS}, "devices": devices,
    })
    return result
