"""Load whichever kind of predictor a folder holds."""

from pathlib import Path

from mixpinn.records import TissueMesh
from mixpinn.reduced.hybrid import HYBRID_FILE
from mixpinn.serving.hybrid_predictor import HybridPredictor
from mixpinn.serving.predictor import Predictor

AnyPredictor = Predictor | HybridPredictor


def load_predictor(
    folder: Path | str, *, mesh: TissueMesh | None = None, threads: int | None = None, name: str | None = None,
) -> AnyPredictor:
    """A trained network or a hybrid model; arguments and errors as `Predictor.load`."""
    kind = HybridPredictor if (Path(folder) / HYBRID_FILE).is_file() else Predictor
    return kind.load(folder, mesh=mesh, threads=threads, name=name)
