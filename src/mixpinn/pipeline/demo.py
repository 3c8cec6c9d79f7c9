"""The demo: the whole pipeline on the built-in phantom, small enough for a laptop's coffee break."""

from dataclasses import replace

from mixpinn.dataset import SMALL
from mixpinn.fem import LocalRefinement
from mixpinn.graph import Scaling
from mixpinn.pipeline.config import RunConfig
from mixpinn.stages.anatomy import AnatomyConfig
from mixpinn.stages.simulation import SimulationConfig
from mixpinn.stages.training import ModelsConfig
from mixpinn.training import TrainConfig

DEMO = RunConfig(
    title="Demo: a probe pressed on a lumbar phantom",
    anatomy=AnatomyConfig(source="phantom"),
    simulation=SimulationConfig(
        protocol=replace(SMALL, max_positions=20, steps=10), joints="none", refinement=LocalRefinement(),
    ),
    models=ModelsConfig(
        names=("hybrid", "mixpinn", "simple-gat"), width="desk", scaling=Scaling.STANDARD,
        train=TrainConfig(learning_rate=2e-3, max_epochs=25),
    ),
)
"""Twenty positions, one rotation, ten steps of 1 mm, the hybrid model and two small networks."""
