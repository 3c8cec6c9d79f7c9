"""RunConfig: the whole pipeline, from label maps to report."""

from dataclasses import dataclass, field

from mixpinn.fem import LocalRefinement
from mixpinn.stages.anatomy import AnatomyConfig
from mixpinn.stages.evaluation import EvaluationConfig
from mixpinn.stages.mesh import PATIENT_CELLS, MeshConfig
from mixpinn.stages.samples import SplitConfig
from mixpinn.stages.simulation import SimulationConfig
from mixpinn.stages.training import ModelsConfig


@dataclass(frozen=True)
class RunConfig:
    """All stages.

    Attributes:
        title: of the report.
        anatomy: label maps.
        mesh: tetrahedra.
        simulation: poses and mechanics.
        split: of the probe positions.
        models: networks and their training.
        evaluation: what is shown.
    """

    title: str = "Deformation of soft tissue with rigid bodies inside"
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)
    mesh: MeshConfig = PATIENT_CELLS
    simulation: SimulationConfig = field(default_factory=lambda: SimulationConfig(refinement=LocalRefinement()))
    split: SplitConfig = field(default_factory=SplitConfig)
    models: ModelsConfig = field(default_factory=ModelsConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
