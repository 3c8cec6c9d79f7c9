"""Fixtures of several stages: the pipeline's artefacts, and a trained model's folder on the toy mesh."""

from pipeline.chain import chain  # noqa: F401
from serving.conftest import folder, mesh, table  # noqa: F401
from training.conftest import validation  # noqa: F401
