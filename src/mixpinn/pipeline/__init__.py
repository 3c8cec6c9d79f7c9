"""What runs several stages."""

from mixpinn.pipeline.ablation import run_ablation
from mixpinn.pipeline.ablation_config import ABLATION_RUNS, ROWS, AblationConfig, OtherProbe
from mixpinn.pipeline.config import RunConfig
from mixpinn.pipeline.demo import DEMO
from mixpinn.pipeline.evaluation_stage import Background, EvaluationConfig, evaluate_models
from mixpinn.pipeline.run import run_pipeline
from mixpinn.pipeline.setup_tables import fidelity_table, findings_table, quality_table
from mixpinn.pipeline.simulation_stage import (
    PAPER_TISSUE_CONFIG,
    SimulationConfig,
    TissueConfig,
    make_scene,
    make_simulations,
)
from mixpinn.pipeline.sofa_stage import export_sofa, import_sofa_recordings
from mixpinn.pipeline.training_stage import ModelsConfig, SplitConfig, load_samples, train_model

__all__ = [
    "ABLATION_RUNS", "DEMO", "PAPER_TISSUE_CONFIG", "ROWS", "AblationConfig", "Background", "EvaluationConfig",
    "ModelsConfig", "OtherProbe", "RunConfig", "SimulationConfig", "SplitConfig", "TissueConfig", "evaluate_models",
    "export_sofa", "fidelity_table", "findings_table", "import_sofa_recordings", "load_samples", "make_scene",
    "make_simulations", "quality_table", "run_ablation", "run_pipeline", "train_model",
]
