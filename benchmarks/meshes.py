"""Meshes of six anatomies: nodes, shape of the cells, fidelity to the label map, seconds.

``python -m benchmarks.meshes`` meshes patient1, patient1 with every second voxel, patient2 (found by the environment
variable MIXPINN_DATA, default ``../shared/data``; left out where absent) and the phantom with seeds 1, 2 and 3. It
prints a table and, as its last line, a JSON object: ``meshes``, ``failed``, ``inverted``, ``min_dihedral``,
``bridging_faces``, ``rigid_dice_min``, ``body_dice_min``.
"""

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import nibabel as nib
import numpy as np

from benchmarks.history import report
from mixpinn.base.config import build_config, parse_overrides
from mixpinn.base.errors import InputError
from mixpinn.records import LabelMap
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy
from mixpinn.stages.mesh import MeshConfig, MeshResult, make_mesh

DATA = Path(os.environ.get("MIXPINN_DATA", Path(__file__).parents[1] / ".." / "shared" / "data"))
HEAD = (
    "| anatomy | nodes | on skin | on parts | with mid-edge nodes | cells | smallest angle [°] | slivers | inverted "
    "| bridging | fixed | Dice body | Dice parts | Hausdorff 95 % parts [mm] | seconds |"
)


def anatomies(names: list[str]) -> dict[str, LabelMap]:
    """The label maps called `names`, or all of those whose data are there."""
    sources = {
        "patient1": AnatomyConfig(source="folder", path=str(DATA / "patient1"), repair=True),
        "patient1-3mm": AnatomyConfig(source="folder", path=str(DATA / "patient1"), repair=True),
        "patient2": AnatomyConfig(
            source="multilabel", path=str(DATA / "patient2" / "multilabel.nii.gz"), repair=True,
            body=str(DATA / "patient2" / "segmentations" / "body_trunc.nii.gz"),
        ),
        **{f"phantom-{seed}": AnatomyConfig(seed=seed, repair=True) for seed in (1, 2, 3)},
    }
    found = {}
    for name, config in sources.items():
        if (names and name not in names) or (config.path and not Path(config.path).exists()):
            continue
        with tempfile.TemporaryDirectory() as folder:
            if name == "patient1-3mm":
                thin(DATA / "patient1", Path(folder))
                config = replace(config, path=folder)
            found[name] = make_anatomy(config).label_map
    return found


def thin(source: Path, target: Path) -> None:
    """Every second voxel of each label map in `source`."""
    for file in source.glob("*.nii.gz"):
        image = nib.load(file)
        affine = image.affine.copy()
        affine[:3, :3] *= 2.0
        nib.save(nib.Nifti1Image(np.asarray(image.dataobj)[::2, ::2, ::2], affine), target / file.name)


def row(name: str, result: MeshResult, seconds: float) -> str:
    """One line of the table."""
    mesh, quality = result.mesh, result.quality
    assert result.fidelity is not None
    body, *parts = result.fidelity.structures
    return (
        f"| {name} | {mesh.n_points} | {len(np.unique(mesh.skin_faces))} | {int((mesh.part > 0).sum())} "
        f"| {mesh.n_points + len(mesh.edges)} | {len(mesh.cells)} | {quality.min_dihedral:.1f} | {quality.slivers} "
        f"| {quality.inverted} | {quality.bridging_faces} | {int(mesh.fixed.sum())} | {body.dice:.4f} "
        f"| {min(p.dice for p in parts):.3f} | {max(p.hausdorff_95 for p in parts):.2f} | {seconds:.0f} |"
    )


def main(names: list[str], config: MeshConfig) -> None:
    """Mesh, measure and print."""
    print(HEAD + "\n|" + " --- |" * HEAD.count(" |"))
    results: list[MeshResult] = []
    failed = []
    for name, label_map in anatomies(names).items():
        start = time.perf_counter()
        try:
            results.append(make_mesh(label_map, config))
        except InputError as error:
            failed.append(f"{name}: {error}")
            continue
        print(row(name, results[-1], time.perf_counter() - start), flush=True)
    for line in failed:
        print(line)
    qualities = [result.quality for result in results]
    structures = [result.fidelity.structures for result in results if result.fidelity is not None]
    report("meshes", {
        "meshes": len(results), "failed": len(failed),
        "inverted": sum(quality.inverted for quality in qualities),
        "min_dihedral": min((quality.min_dihedral for quality in qualities), default=None),
        "bridging_faces": sum(quality.bridging_faces for quality in qualities),
        "rigid_dice_min": min((s.dice for found in structures for s in found[1:]), default=None),
        "body_dice_min": min((found[0].dice for found in structures), default=None),
    })


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("anatomies", nargs="*", help="some of the six; all by default")
    parser.add_argument("--set", action="append", default=[], help="a setting of the mesh, for example size=0.7")
    options = parser.parse_args()
    main(options.anatomies, build_config(MeshConfig, parse_overrides([*options.set, "picture=false"])))
