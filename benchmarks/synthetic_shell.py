"""Label maps with a synthetic shell of fat: what is within 15 mm of the skin, and muscle as all other soft tissue.

``python -m benchmarks.synthetic_shell MAPS --out FOLDER`` copies the maps of a folder with one NIfTI a structure and
adds ``subcutaneous_fat_synthetic.nii.gz`` and ``skeletal_muscle_synthetic.nii.gz``; with ``phantom`` instead of a
folder, the maps are those of the built-in phantom (``--seed``). ``mixpinn onboard FOLDER --layers`` then takes them. It
serves to try layers on anatomies that come without: no figure made with it says anything about a patient's fat. The
last line is a JSON object with the volume of each map [litres].
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy import ndimage

from benchmarks.history import report
from mixpinn.anatomy.phantom import phantom_segmentation
from mixpinn.anatomy.read import read_folder
from mixpinn.anatomy.segmentation import Segmentation
from mixpinn.base.files import atomic_path

_parser = argparse.ArgumentParser(prog="python -m benchmarks.synthetic_shell", description=__doc__)
_parser.add_argument("maps", help="folder of label maps, or 'phantom'")
_parser.add_argument("--out", type=Path, required=True)
_parser.add_argument("--thickness", type=float, default=15.0, help="of the fat [mm]")
_parser.add_argument("--seed", type=int, help="of the phantom's variation")


def with_shell(segmentation: Segmentation, thickness: float) -> dict[str, np.ndarray]:
    """Masks of the body, its bones, and the two synthetic tissues, on the whole grid."""
    start, stop = (0, 0, 0), segmentation.shape
    body = segmentation.body.window(start, stop)
    bones = {part.name: part.window(start, stop) for part in segmentation.rigid}
    # What ends with the grid is no skin: only voxels count that are beside the body.
    away = ndimage.distance_transform_edt(body, sampling=segmentation.spacing)
    soft = body & ~np.any(list(bones.values()), axis=0)
    return {
        segmentation.body.name: body, **bones, "subcutaneous_fat_synthetic": soft & (away <= thickness),
        "skeletal_muscle_synthetic": soft & (away > thickness),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the maps."""
    import nibabel as nib

    options = _parser.parse_args(arguments)
    if options.maps == "phantom":
        found = phantom_segmentation(None, rng=None if options.seed is None else np.random.default_rng(options.seed))
    else:
        found = read_folder(options.maps)
    options.out.mkdir(parents=True, exist_ok=True)
    litres = {}
    for name, mask in with_shell(found, options.thickness).items():
        with atomic_path(options.out / f"{name}.nii.gz") as temporary:
            nib.save(nib.Nifti1Image(mask.astype(np.uint8), found.affine), temporary)
        litres[name] = float(mask.sum() * np.prod(found.spacing)) / 1e6
    report("synthetic_shell", litres)


if __name__ == "__main__":
    main()
