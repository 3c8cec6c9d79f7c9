"""The frozen records that pass between stages, each with `save` and `load` in an open format."""

from mixpinn.records.answer import Answer, Contact, Motion, Source, Trust
from mixpinn.records.evaluation import Evaluation
from mixpinn.records.label_map import LabelMap
from mixpinn.records.probe import Probe, ProbePath
from mixpinn.records.samples import Sample, SampleTable
from mixpinn.records.simulation import Simulation
from mixpinn.records.tissue_mesh import MESH_FILE, TissueMesh

__all__ = [
    "MESH_FILE", "Answer", "Contact", "Evaluation", "LabelMap", "Motion", "Probe", "ProbePath", "Sample", "SampleTable",
    "Simulation", "Source", "TissueMesh", "Trust",
]
