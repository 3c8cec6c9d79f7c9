"""The hybrid stage: simulations in, a predictor bundle with prior, correction and calibration out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mixpinn.base.rundir import finish_run, is_finished, start_run
from mixpinn.dataset import SimulationStore, Split
from mixpinn.fem import Material
from mixpinn.models import MESH_FILE
from mixpinn.models.hybrid import HYBRID_FILE, HybridModel
from mixpinn.models.prior import ElasticPrior
from mixpinn.pipeline.evaluation_stage import build_prior
from mixpinn.pipeline.simulation_stage import TissueConfig
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.training.hybrid import HybridConfig, fit_hybrid


@dataclass(frozen=True)
class HybridStageConfig:
    """What the hybrid model is made from.

    Attributes:
        tissue: of all soft tissue that `tissues` does not name: what the simulations were made with.
        tissues: by name of the mesh's tissue.
        hybrid: modes, features and regression.
    """

    tissue: TissueConfig = field(default_factory=TissueConfig)
    tissues: dict[str, TissueConfig] = field(default_factory=dict)
    hybrid: HybridConfig = field(default_factory=HybridConfig)


def mesh_materials(mesh: TissueMesh, tissues: Mapping[str, TissueConfig], default: TissueConfig) -> Sequence[Material]:
    """The material of each tissue of the mesh."""
    return [tissues.get(name, default).material() for name in mesh.tissue_names]


def make_hybrid(
    store: SimulationStore, table: SampleTable, split: Split, config: HybridStageConfig, *, out: Path | str,
) -> HybridModel:
    """Fit the hybrid model on the training positions and calibrate it on the validation positions.

    Args:
        store: the simulations.
        table: their samples.
        split: of the positions.
        config: tissue and regression.
        out: run directory: the predictor bundle; a finished one is loaded.

    Raises:
        InputError: `out` holds another run.
    """
    out, mesh = Path(out), store.mesh()
    begun = start_run(
        out, "hybrid", config, seed=config.hybrid.seed, inputs={"store": store.folder / "store.json"},
        input_hashes={"mesh": mesh.hash(), "split": split.identity()},
    )
    if begun and is_finished(out) and (out / HYBRID_FILE).is_file():
        return HybridModel.load(out, mesh)
    prior: ElasticPrior = build_prior(mesh, config.tissues, config.tissue, table)
    model = fit_hybrid(
        prior, mesh_materials(mesh, config.tissues, config.tissue), table.at_positions(split.train),
        table.at_positions(split.validation), config.hybrid,
    )
    mesh.save(out / MESH_FILE)
    model.save(out)
    finish_run(out, {"model": model.about})
    return model
