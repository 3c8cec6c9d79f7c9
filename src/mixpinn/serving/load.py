"""Load whichever kind of predictor a folder holds."""

from pathlib import Path
from typing import TYPE_CHECKING, Union

from mixpinn.base.errors import InputError
from mixpinn.base.manifest import MANIFEST
from mixpinn.records import TissueMesh
from mixpinn.reduced.hybrid import HYBRID_FILE
from mixpinn.serving.hybrid_predictor import HybridPredictor

if TYPE_CHECKING:
    from mixpinn.serving.predictor import Predictor

_NETWORK_FILE = "model.json"
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
    if Path(folder).is_dir() and not any((Path(folder) / name).exists() for name in (_NETWORK_FILE, MANIFEST)):
        raise InputError(
            str(folder), expected="a bundle or a trained network",
            got=f"a folder without {HYBRID_FILE} and {_NETWORK_FILE}",
            fix="give the folder that 'mixpinn train' or 'mixpinn onboard' wrote",
        )
    # Imported here: networks need torch.
    from mixpinn.serving.predictor import Predictor

    return Predictor.load(folder, mesh=mesh, threads=threads, name=name, warm_up=warm_up)
