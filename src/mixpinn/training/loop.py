"""The training loop of the paper: AdamW, plateau decay, early stop, on one device or several."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import torch
from torch import nn
from torch.multiprocessing.spawn import ProcessRaisedException

from mixpinn.base.errors import InputError, MixpinnError, SolveError
from mixpinn.base.progress import console
from mixpinn.graph import MeshGraph
from mixpinn.networks import DisplacementModel, ModelConfig, build_graph_for, describe_training, save_checkpoint
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.training.arithmetic import settle_arithmetic
from mixpinn.training.batches import batches
from mixpinn.training.config import TrainConfig
from mixpinn.training.history import EpochRecord, StopReason, TrainingResult, read_history, write_history
from mixpinn.training.job import TrainingJob
from mixpinn.training.monitor import EpochLog, TrainingProgress
from mixpinn.training.objective import new_model, training_loss
from mixpinn.training.schedule import Schedule
from mixpinn.training.state import epoch_seed, load_state, save_state

if TYPE_CHECKING:
    from lightning.fabric import Fabric

Accelerator = Literal["auto", "cpu", "cuda", "mps"]

_PRECISION: dict[str, Any] = {"float32": "32-true", "bfloat16": "bf16-mixed"}


def train(
    model_config: ModelConfig, train_config: TrainConfig, *, mesh: TissueMesh, table_train: SampleTable,
    table_validation: SampleTable, out: Path | str, devices: int = 1, accelerator: Accelerator = "auto",
) -> TrainingResult:
    """Train a network, or continue a run that was interrupted.

    After every epoch the whole state is written, so that a run killed at any moment continues from the last complete
    epoch and, on CPUs, follows the same loss curve as one that was never interrupted: to the last bit in one process,
    and between processes up to the last digits of matrix products. The random numbers of the caller stay untouched.

    Args:
        model_config: the network; its REL weight decides the loss.
        train_config: optimizer, schedule, limits; what is None becomes the network's own.
        mesh: the mesh of the samples.
        table_train: training samples.
        table_validation: samples that decide learning rate, early stop and which weights are kept.
        out: model folder to write.
        devices: processes, each with a device of its own; more than one train by distributed data parallelism.
        accelerator: kind of device.

    Returns:
        the outcome; the weights of the best epoch lie in `out`.

    Raises:
        InputError: samples of another mesh or none, or `out` holds another run.
        SolveError: the loss is not a number any more (with several devices its base, `MixpinnError`).
    """
    if devices < 1:
        raise InputError("devices", expected="at least 1", got=str(devices), fix="train on one device")
    job = TrainingJob(
        model_config, train_config.for_model(model_config), mesh, table_train, table_validation, Path(out),
    )
    stopped_by = _launch(_fabric(devices, accelerator, train_config), job)
    history = read_history(job.folder)
    best = min(history, key=lambda record: record.validation_loss)
    result = TrainingResult(
        job.folder, history, best.epoch, best.validation_loss, sum(record.seconds for record in history), stopped_by,
    )
    console.print(
        f"Training ended after epoch {len(history)} ({stopped_by}); "
        f"best epoch {best.epoch}, validation loss {best.validation_loss:.4g} mm.", soft_wrap=True,
    )
    return result


def _fabric(devices: int, accelerator: Accelerator, config: TrainConfig) -> "Fabric":
    # Imported here: it takes seconds, and the rest of the package does not need it.
    from lightning.fabric import Fabric
    from lightning.fabric.strategies import DDPStrategy

    strategy: Any = "auto"
    if devices > 1:
        # Processes started from outside (torchrun) are used as they are; else this process starts them.
        start = "popen" if torch.distributed.is_torchelastic_launched() else "spawn"
        strategy = DDPStrategy(start_method=start)
    return Fabric(
        accelerator=accelerator, devices=devices, strategy=strategy, precision=_PRECISION[config.precision],
    )


def _launch(fabric: "Fabric", job: TrainingJob) -> StopReason:
    """Run the job in every process; errors that a user can mend come back from other processes as one line."""
    try:
        # Bound into the function, since Fabric does not take frozen dataclasses as arguments.
        reason: StopReason = fabric.launch(partial(_run, job=job))
    except ProcessRaisedException as error:
        last = str(error).strip().splitlines()[-1]
        if not last.startswith(MixpinnError.__module__):
            raise
        raise MixpinnError(last.partition(": ")[2]) from error
    return reason


@contextmanager
def _surroundings(config: TrainConfig) -> Iterator[None]:
    """Set the threads, and give the caller back its own threads and random numbers afterwards."""
    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=range(torch.cuda.device_count())):
        if config.threads is not None:
            torch.set_num_threads(config.threads)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def _run(fabric: "Fabric", job: TrainingJob) -> StopReason:
    """The whole run as one process sees it."""
    config, leads = job.config, fabric.is_global_zero
    settle_arithmetic()
    with _surroundings(config):
        graph = build_graph_for(job.model_config, job.mesh)
        module = new_model(job.model_config, graph, job.table_train, seed=epoch_seed(config.seed, 0))
        optimizer = torch.optim.AdamW(
            module.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay,
        )
        network, stepper = fabric.setup(module, optimizer)
        identity = job.identity()
        history = load_state(job.folder, module, optimizer, identity=identity)
        schedule = Schedule.start(config).replay((record.validation_loss for record in history), config)
        log = EpochLog(job.folder, first_epoch=len(history) + 1) if leads else None
        fabric.barrier()
        with (log or nullcontext()), TrainingProgress(job.table_train, config, len(history), visible=leads) as progress:
            while (reason := _stop_reason(history, schedule, config)) is None:
                epoch, began = len(history) + 1, time.perf_counter()
                for group in optimizer.param_groups:
                    group["lr"] = schedule.learning_rate
                progress.start_epoch(epoch, schedule.best_loss)
                train_loss = _train_epoch(fabric, network, stepper, graph, job, epoch, progress)
                validation_loss = _validate(fabric, module, graph, job)
                seconds: float = fabric.broadcast(time.perf_counter() - began)
                record = EpochRecord(epoch, train_loss, validation_loss, schedule.learning_rate, seconds)
                if not (math.isfinite(train_loss) and math.isfinite(validation_loss)):
                    raise SolveError(
                        f"training diverged in epoch {epoch} (training loss {train_loss}, validation loss "
                        f"{validation_loss}): lower learning_rate ({schedule.learning_rate:g}) or scale the inputs",
                    )
                history.append(record)
                schedule = schedule.after(validation_loss, config)
                if log is not None:
                    _write_epoch(job, module, optimizer, history, schedule, identity)
                    log.add(record)
        if leads:
            describe_training(job.folder, job.model_config, job.mesh, job.summary(history, reason))
            write_history(job.folder, history)  # listed in the manifest that stands now
        fabric.barrier()
    return reason


def _stop_reason(history: list[EpochRecord], schedule: Schedule, config: TrainConfig) -> StopReason | None:
    """Why no further epoch is to be begun, or None."""
    if schedule.exhausted(config):
        return "early stop"
    if len(history) >= config.max_epochs:
        return "epoch limit"
    # At least one epoch, since without it there is no model.
    if history and config.time_budget is not None and sum(r.seconds for r in history) >= config.time_budget:
        return "time budget"
    return None


def _train_epoch(
    fabric: "Fabric", network: nn.Module, stepper: Any, graph: MeshGraph, job: TrainingJob, epoch: int,
    progress: TrainingProgress,
) -> float:
    """One pass over the shuffled training samples; the mean loss while the weights moved [mm]."""
    config, on_device = job.config, graph.to(fabric.device)
    # The order is the same in every process, dropout is not.
    generator = torch.Generator().manual_seed(epoch_seed(config.seed, epoch, 0))
    torch.manual_seed(epoch_seed(config.seed, epoch, 1, fabric.global_rank))
    network.train()
    total = torch.zeros((), dtype=torch.float64)
    for batch in batches(
        job.table_train, graph, batch_size=config.batch_size, generator=generator, rank=fabric.global_rank,
        processes=fabric.world_size,
    ):
        stepper.zero_grad()
        prediction = network(batch.contact_displacement.to(fabric.device))
        loss = training_loss(job.model_config, on_device, prediction, batch.target.to(fabric.device))
        fabric.backward(loss * batch.weight)
        stepper.step()
        total += loss.item() * batch.n_samples
        progress.advance()
    return _mean_over_processes(fabric, total, len(job.table_train))


def _validate(fabric: "Fabric", module: DisplacementModel, graph: MeshGraph, job: TrainingJob) -> float:
    """Mean loss over the validation samples [mm]."""
    on_device = graph.to(fabric.device)
    module.eval()
    total = torch.zeros((), dtype=torch.float64)
    with torch.no_grad(), fabric.autocast():
        for batch in batches(
            job.table_validation, graph, batch_size=job.config.batch_size, rank=fabric.global_rank,
            processes=fabric.world_size,
        ):
            if batch.n_samples:
                prediction = module(batch.contact_displacement.to(fabric.device))
                loss = training_loss(job.model_config, on_device, prediction, batch.target.to(fabric.device))
                total += loss.item() * batch.n_samples
    return _mean_over_processes(fabric, total, len(job.table_validation))


def _mean_over_processes(fabric: "Fabric", total: torch.Tensor, n_samples: int) -> float:
    summed = fabric.all_reduce(total.to(fabric.device), reduce_op="sum") \
        if fabric.world_size > 1 else total
    return float(summed.item()) / n_samples


def _write_epoch(
    job: TrainingJob, module: DisplacementModel, optimizer: torch.optim.Optimizer, history: list[EpochRecord],
    schedule: Schedule, identity: dict[str, Any],
) -> None:
    """Write what the epoch brought. The state comes last but for the log: a run killed before it repeats the epoch."""
    if schedule.improved:
        save_checkpoint(job.folder, module, job.model_config, job.mesh, training=job.summary(history))
    save_state(job.folder, module, optimizer, history, identity=identity)
    write_history(job.folder, history)
