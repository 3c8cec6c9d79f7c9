"""The run-time table: solver, elastic prior and every network, on the paper's mesh and on a coarser and a finer one.

``python -m benchmarks.profile`` prints the tables of ``mixpinn profile`` and, as its last line, a JSON list with one
object a mesh and method. It takes the paper's mesh and the label maps of its patient, found by the environment variable
MIXPINN_DATA (default ``../shared/data``); where they are absent, three meshes of the built-in phantom serve. Meshes and
measurements lie in ``--out``, so that a command that was stopped continues.
"""

import argparse
import os
from dataclasses import asdict, replace
from pathlib import Path

from benchmarks.history import report
from mixpinn.mesh import load_paper_mesh
from mixpinn.records import TissueMesh
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy
from mixpinn.stages.mesh import MeshConfig, make_mesh
from mixpinn.studies.profile import ProfileConfig, run_profile

ROOT = Path(__file__).parents[1]


def patient_meshes(folder: Path, out: Path, sizes: tuple[float, float]) -> dict[str, TissueMesh]:
    """The paper's mesh between a coarser and a finer one of the same patient."""
    label_map = make_anatomy(AnatomyConfig(source="folder", path=str(folder)), out=out / "anatomy").label_map
    coarse, fine = (
        make_mesh(label_map, MeshConfig(size=size), out=out / f"mesh-{size:g}").mesh for size in sizes
    )
    return {"coarser": coarse, "paper": load_paper_mesh(folder / "paper"), "finer": fine}


def phantom_meshes(out: Path) -> dict[str, TissueMesh]:
    """Three meshes of the phantom."""
    label_map = make_anatomy(AnatomyConfig(source="phantom"), out=out / "anatomy").label_map
    return {
        name: make_mesh(label_map, MeshConfig(size=size), out=out / f"mesh-{size:g}").mesh
        for name, size in (("coarser", 3.0), ("middle", 2.0), ("finer", 1.4))
    }


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=40)
    parser.add_argument("--width", type=int, default=128, help="channels a head")
    parser.add_argument("--sizes", type=float, nargs=2, default=(2.0, 0.75), help="of the coarser and the finer mesh")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "profile")
    options = parser.parse_args(arguments)
    data = Path(os.environ.get("MIXPINN_DATA", ROOT / ".." / "shared" / "data")) / "patient1"
    there = (data / "paper" / "body.vtu").is_file()
    meshes = patient_meshes(data, options.out, tuple(options.sizes)) if there else phantom_meshes(options.out)
    config = replace(ProfileConfig(), threads=options.threads, repeats=options.repeats, hidden=options.width)
    timings = run_profile(meshes, config, out=options.out / f"threads-{options.threads}")
    report("profile", [asdict(entry) for entry in timings], kept={
        f"{entry.method}, {entry.mesh} ms": entry.median_ms for entry in timings
    })


if __name__ == "__main__":
    main()
