"""The training stage: the samples of a store in, one model folder out that explains itself and can be resumed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from mixpinn.base.errors import InputError
from mixpinn.base.rundir import finish_run, run_scope, start_run
from mixpinn.dataset import SimulationStore, Split
from mixpinn.graph import Scaling
from mixpinn.networks import MODELS, ModelConfig
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.reduced.fit import HybridConfig
from mixpinn.stages.samples import choose_samples
from mixpinn.training import TrainConfig, TrainingResult, train
from mixpinn.training.job import LIMITS, TrainingJob
from mixpinn.training.loop import Accelerator

HYBRID = "hybrid"
"""Name of the elastic prior with a learned correction."""

@dataclass(frozen=True)
class ModelsConfig:
    """Which models are trained, and how.

    Attributes:
        names: ``hybrid``, or models of the paper's tables: ``mixpinn``, ``simple-gat``, ``physgnn`` or ``row-1`` …
            ``row-13``.
        width: channels a head: ``tiny``, ``desk``, ``authors`` or ``paper``.
        scaling: of inputs and outputs: ``none`` (millimetres as they are, as in the paper) or ``standard``.
        train: optimizer and schedule.
        hybrid: modes, features and regression of the hybrid model.
    """

    names: tuple[str, ...] = ("mixpinn", "simple-gat")
    width: str = "authors"
    scaling: Scaling = Scaling.NONE
    train: TrainConfig = field(default_factory=TrainConfig)
    hybrid: HybridConfig = field(default_factory=HybridConfig)

    def __post_init__(self) -> None:
        for name in self.names:
            if name != HYBRID:
                self.model(name)

    def model(self, name: str) -> ModelConfig:
        """Configuration of the model `name`.

        Raises:
            InputError: an unknown name or width.
        """
        if name not in MODELS:
            raise InputError(
                f"model {name!r}", expected="one of " + ", ".join((HYBRID, *MODELS)), got=name,
                fix="choose one of them",
            )
        return replace(MODELS[name].with_width(self.width), scaling=self.scaling)


def train_model(
    store: SimulationStore, table: SampleTable, split: Split, name: str, config: ModelsConfig, *, out: Path | str,
    devices: int = 1, held_out: str | None = None,
) -> TrainingResult:
    """Train one network in the run directory `out`; an interrupted run continues.

    Args:
        store: the simulations.
        table: their samples.
        split: of their positions.
        name: of the network.
        config: width, scaling, optimizer.
        out: run directory.
        devices: processes, each with a device of its own.
        held_out: a hold-out by name whose samples training and validation do not see.

    Raises:
        InputError: an unknown name, or `out` holds another run.
        SolveError: the loss is not a number any more.
    """
    samples = choose_samples(table, split, held_out)
    return train_network(
        store.mesh(), table.select(samples.train), table.select(samples.validation), config.model(name), config.train,
        out=out, inputs={"store": store.folder / "store.json"}, devices=devices,
    )


@run_scope()
def train_network(
    mesh: TissueMesh, table_train: SampleTable, table_validation: SampleTable, model: ModelConfig, config: TrainConfig,
    *, out: Path | str, inputs: Mapping[str, Path | str] | None = None, devices: int = 1,
    accelerator: Accelerator = "auto",
) -> TrainingResult:
    """Train on tables of samples in the run directory `out`, which is the model folder too; a run there continues.

    The limits (`max_epochs`, `time_budget`, `threads`) may differ between the sessions of a run: a finished one is
    extended by giving it more.

    Args:
        mesh: the mesh of the samples.
        table_train: training samples.
        table_validation: validation samples.
        model: the network.
        config: optimizer, schedule, limits; what is None becomes the network's own.
        out: run directory: ``run.json``, the model (``weights.safetensors``, ``model.json``, ``mesh.vtu``),
            ``state.safetensors``, ``history.csv`` and ``tensorboard/``.
        inputs: files that the samples came from, for the record.
        devices: processes, each with a device of its own.
        accelerator: kind of device.

    Raises:
        InputError: samples of another mesh or none, or `out` holds another run.
        SolveError: the loss is not a number any more.

    Example:
        >>> from mixpinn.networks import MIXPINN
        >>> network, settings = MIXPINN.with_width("tiny"), TrainConfig(max_epochs=1, threads=1)
        >>> learned, valid = table.at_positions([0, 1]), table.at_positions([2])
        >>> len(train_network(mesh, learned, valid, network, settings, out="runs/new").history)
        1
    """
    settings = config.for_model(model)
    job = TrainingJob(model, settings, mesh, table_train, table_validation, Path(out))
    start_run(out, "train", job.settings, inputs=inputs, seed=settings.seed, input_hashes=job.input_hashes)
    result = train(
        model, settings, mesh=mesh, table_train=table_train, table_validation=table_validation, out=out,
        devices=devices, accelerator=accelerator,
    )
    finish_run(out, {
        **{name: value for name, value in job.summary(result.history, result.stopped_by).items() if name != "settings"},
        "limits": {name: getattr(settings, name) for name in LIMITS}, "devices": devices,
    })
    return result
