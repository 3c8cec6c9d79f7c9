"""Manifests for what an older version wrote without one."""

from pathlib import Path

from mixpinn.base.errors import InputError
from mixpinn.base.manifest import Artefact
from mixpinn.dataset import store
from mixpinn.networks import checkpoint
from mixpinn.records import MESH_FILE, samples
from mixpinn.records.error_budget import BUDGET_FILE
from mixpinn.records.label_map import label_map_files
from mixpinn.reduced import hybrid, prior
from mixpinn.stages.anatomy import LABELS_FILE
from mixpinn.stages.mesh import MESH_RUN, MESH_RUN_FILES
from mixpinn.training.history import HISTORY_FILE

_LABELS = label_map_files(Path(LABELS_FILE))
_STORE = "store"


def seal_folder(folder: Path | str) -> list[tuple[Path, Artefact]]:
    """Write the manifests that are absent in `folder`, for files that its owner trusts; good and bad ones stay.

    Args:
        folder: a label map, a mesh, simulations, samples, a trained network, a bundle or a prior.

    Returns:
        The folders that got a manifest, and of what.

    Raises:
        InputError: none of them.
    """
    folder = Path(folder)
    if (folder / _STORE / store.RECORD).is_file():
        folder = folder / _STORE
    found: list[tuple[Path, Artefact, tuple[str, ...]]] = [
        (where, artefact, names) for where, artefact, names in (
            (folder, _LABELS, (LABELS_FILE, LABELS_FILE.replace(".nii.gz", ".json"))),
            (folder, store.STORE, (store.RECORD, MESH_FILE, store.PROBE)),
            (folder, checkpoint.NETWORK, (checkpoint.MODEL_FILE, checkpoint.WEIGHTS_FILE, MESH_FILE, HISTORY_FILE)),
            (folder, prior.PRIOR, prior.FILES),
            (folder / hybrid.PRIOR_FOLDER, prior.PRIOR, prior.FILES),
            (folder, hybrid.BUNDLE, (*hybrid.FILES, BUDGET_FILE)),
            (folder, MESH_RUN, (*MESH_RUN_FILES[1:], MESH_FILE)),
            (folder, samples.SAMPLE_TABLE, samples.FILES),
        ) if (where / names[0]).is_file()
    ]
    if not found:
        raise InputError(
            str(folder), expected="a label map, a mesh, simulations, a trained network or a bundle", got="none of them",
            fix="give the folder that 'mixpinn' wrote",
        )
    sealed = []
    for where, artefact, names in found:
        if not artefact.is_sealed(where):
            artefact.seal(where, [name for name in names if (where / name).is_file()])
            sealed.append((where, artefact))
    return sealed
