"""Load whichever kind of predictor a folder holds."""

from pathlib import Path
from typing import TYPE_CHECKING, Union

from mixpinn.records import TissueMesh
from mixpinn.reduced.hybrid import HYBRID_FILE
from mixpinn.serving.hybrid_predictor import HybridPredictor

if TYPE_CHECKING:
    from mixpinn.serving.predictor import Predictor

AnyPredictor = Union["Predictor", HybridPredictor]


def load_predictor(
    folder: Path | str, *, mesh: TissueMesh | None = None, threads: int | None = None, name: str | None = None,
    warm_up: bool = True, with_budget: bool = True,
) -> AnyPredictor:
    """A trained network or a hybrid model; arguments and errors as `HybridPredictor.load`."""
    if (Path(folder) / HYBRID_FILE).is_file():
        return HybridPredictor.load(
            folder, mesh=mesh, threads=threads, name=name, warm_up=warm_up, with_budget=with_budget,
        )
    # Imported here: networks need torch.
    from mixpinn.serving.predictor import Predictor

    return Predictor.load(folder, mesh=mesh, threads=threads, name=name, warm_up=warm_up)
