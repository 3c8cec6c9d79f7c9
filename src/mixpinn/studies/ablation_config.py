"""AblationConfig: the paper's experiments as one table of settings, at two scales."""

from dataclasses import dataclass, field

from mixpinn.base.errors import InputError
from mixpinn.dataset import PAPER, Protocol
from mixpinn.graph import Scaling
from mixpinn.networks import ABLATION, MODELS
from mixpinn.stages.anatomy import AnatomyConfig
from mixpinn.stages.mesh import MeshConfig
from mixpinn.stages.samples import SplitConfig
from mixpinn.stages.simulation import PAPER_TISSUE_CONFIG, SimulationConfig
from mixpinn.training import TrainConfig

ROWS = (*(f"row-{number}" for number in ABLATION), "physgnn")
"""The rows of the table: thirteen of the ablation, of which 1 is the simple GAT and 10 MIXPINN, and PhysGNN."""

STANDSTILL = 900.0
"""By default a training whose process shows no sign of life for so long is ended [s]."""


@dataclass(frozen=True)
class OtherProbe:
    """The hold-out with a probe of another footprint: a linear transducer, pressed at positions never trained on.

    Attributes:
        length, width: of its face [mm].
        rotations: at which it is pressed [degree].
    """

    length: float = 30.0
    width: float = 10.0
    rotations: tuple[float, ...] = (0.0, 90.0)


@dataclass(frozen=True)
class AblationConfig:
    """What is trained, on what, and what it is tested on.

    Attributes:
        anatomy: label maps, where the source is not a mesh or simulations.
        mesh: tetrahedra, where the source is label maps.
        simulation: poses and mechanics, where the source is not simulations.
        split: of the probe positions.
        models: of the paper's tables: ``row-1`` … ``row-13``, ``physgnn``.
        repeated: rows that are trained with every seed.
        seeds: their seeds; the other rows take the first.
        few_positions: numbers of training positions at which `few_row` is trained once more with the first seed.
        few_row: the row of the data-need curve.
        layers: attention layers.
        hidden: channels a head of the attention layers.
        physgnn_hidden: channels of PhysGNN's convolutions.
        scaling: of inputs and outputs, the same for all rows.
        train: optimizer, schedule and limits.
        physgnn_learning_rate, physgnn_batch_size: PhysGNN's own, those of its authors.
        passes: samples that pass through a network in training, validation not counted: the budget of every run,
            rounded to whole epochs; None leaves the limit to `train.max_epochs`.
        unseen_rotations: rotations left out of training and validation [degree]; a hold-out.
        deepest_seen: depth beyond which samples are left out of training and validation [mm]; a hold-out.
        other_probe: the hold-out with another probe; None leaves it out.
        noise: standard deviation of the error of each contact displacement in the hold-out ``noise`` [mm].
        pictures: draw the tables' plots.
        timeout: a training whose process stands still for so long is ended [s].
    """

    anatomy: AnatomyConfig = field(default_factory=lambda: AnatomyConfig(source="folder"))
    mesh: MeshConfig = field(default_factory=MeshConfig)
    simulation: SimulationConfig = field(default_factory=lambda: SimulationConfig(tissue=PAPER_TISSUE_CONFIG))
    split: SplitConfig = field(default_factory=SplitConfig)
    models: tuple[str, ...] = ROWS
    repeated: tuple[str, ...] = ("row-1", "row-2", "row-10", "row-11", "physgnn")
    seeds: tuple[int, ...] = (0, 1, 2)
    few_positions: tuple[int, ...] = ()
    few_row: str = "row-10"
    layers: int = 8
    hidden: int = 128
    physgnn_hidden: int = 112
    scaling: Scaling = Scaling.NONE
    train: TrainConfig = field(default_factory=TrainConfig)
    physgnn_learning_rate: float = 5e-3
    physgnn_batch_size: int = 8
    passes: int | None = None
    unseen_rotations: tuple[float, ...] = ()
    deepest_seen: float | None = None
    other_probe: OtherProbe | None = field(default_factory=OtherProbe)
    noise: float = 0.2
    pictures: bool = True
    timeout: float = STANDSTILL

    def __post_init__(self) -> None:
        for name in (*self.models, *self.repeated, self.few_row):
            if name not in MODELS:
                raise InputError(
                    f"row {name!r}", expected="one of " + ", ".join(ROWS), got=name, fix="choose one of them",
                )
        checks = {
            "models": (len(set(self.models)) == len(self.models) > 0, "at least one model, each once"),
            "seeds": (len(set(self.seeds)) == len(self.seeds) > 0, "at least one seed, each once"),
            "passes": (self.passes is None or self.passes > 0, "a positive number"),
            "few_positions": (all(count > 0 for count in self.few_positions), "positive numbers"),
            "noise": (self.noise >= 0.0, "zero or a positive length"),
        }
        for name, (met, expected) in checks.items():
            if not met:
                raise InputError(name, expected=expected, got=repr(getattr(self, name)), fix="correct the setting")


PAPER_ABLATION_RUN = AblationConfig(simulation=SimulationConfig(tissue=PAPER_TISSUE_CONFIG, protocol=PAPER))
"""The paper's experiments at full size: its poses, its widths as its authors used them, its optimizer."""

DESK_ABLATION_RUN = AblationConfig(
    # Coarser than the paper's by a sixth of the nodes only: on coarser meshes still, eight layers reach nearly every
    # node of the vertebrae through the soft tissue, and nothing is left that virtual nodes could bring.
    mesh=MeshConfig(size=1.1),
    simulation=SimulationConfig(
        tissue=PAPER_TISSUE_CONFIG,
        # 1 mm above first touch, then 4, 9, 14 and 19 mm deep.
        protocol=Protocol(approach=6.0, step=5.0, steps=5, start="touch", max_positions=132),
    ),
    few_positions=(12, 24, 48), hidden=16, physgnn_hidden=16, scaling=Scaling.STANDARD,
    # Batches of one make the most optimizer steps of a small budget.
    train=TrainConfig(learning_rate=3e-3, decay_factor=0.5, decay_patience=1, batch_size=1), passes=2500,
    unseen_rotations=(135.0,), deepest_seen=15.0,
)
"""The same experiments on a desk: a coarser mesh, steps of 5 mm, an eighth of the width, an equal budget for all."""

ABLATION_RUNS: dict[str, AblationConfig] = {"desk": DESK_ABLATION_RUN, "paper": PAPER_ABLATION_RUN}
"""The two protocols by name."""
