"""RunConfig: the whole pipeline, from label maps to report."""

from dataclasses import dataclass, field

from mixpinn.anatomy import AnatomyConfig
from mixpinn.mesh import MeshConfig
from mixpinn.pipeline.evaluation_stage import EvaluationConfig
from mixpinn.pipeline.simulation_stage import SimulationConfig
from mixpinn.pipeline.training_stage import ModelsConfig, SplitConfig


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
    mesh: MeshConfig = field(default_factory=MeshConfig)
    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    split: SplitConfig = field(default_factory=SplitConfig)
    models: ModelsConfig = field(default_factory=ModelsConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
