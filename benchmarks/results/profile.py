"""Section of the run-time table: what ``mixpinn profile`` or ``python -m benchmarks.profile`` measured."""

import shutil
from pathlib import Path

from benchmarks.results.section import Data, Section
from mixpinn.base.files import atomic_path, read_json
from mixpinn.studies.profile_tables import exponent_table, profile_table

PICTURES = ("cost.png", "depth.png")


def collect(run: Path, images: Path) -> Data:
    """Timings of a finished run directory, and its pictures."""
    for picture in PICTURES:
        with atomic_path(images / f"profile-{picture}") as temporary:
            shutil.copyfile(run / picture, temporary)
    return dict(read_json(run / "results.json"))


def render(data: Data) -> str:
    """The section."""
    timings = data["timings"]
    return "\n".join([
        *_words(data), profile_table(timings).markdown(), exponent_table(timings).markdown(),
        "![Cost against size](images/profile-cost.png)\n", "![Time against depth](images/profile-depth.png)\n",
    ])


def brief(data: Data) -> str:
    """The section in short: the paper's mesh alone."""
    timings = [entry for entry in data["timings"] if entry["mesh"] == "paper"]
    return "\n".join([
        *_words(data), profile_table(timings).markdown(), "![Cost against size](images/profile-cost.png)\n",
    ])


def _words(data: Data) -> list[str]:
    timings = data["timings"]
    faster = [
        f"{entry['median_ms']:.0f} ms against {solver['median_ms']:.0f} ms for a step of the solver on the mesh "
        f"“{entry['mesh']}”"
        for entry in timings if entry["method"] == "row-10"
        for solver in timings if solver["method"] == "fem" and solver["mesh"] == entry["mesh"]
    ]
    return [
        "## Run time\n",
        f"Command: `python -m benchmarks.profile --threads {data['threads']}`. Machine: {data['machine']}. Untrained "
        f"networks, which cost as much as trained ones, of {data['hidden']} channels a head (PhysGNN: "
        f"{data['physgnn_hidden']} channels). MIXPINN takes {'; '.join(faster)}.\n",
        "The paper compares 73 ms on a graphics card with 1,010 ms of SOFA on a 64-core processor. The comparison here "
        "is on one processor with the same number of threads for all, and this project's solver is faster than the "
        "paper's, so that the ratio is smaller.\n",
    ]


PROFILE = Section("profile", collect, render, brief=brief, help="run directory of 'mixpinn profile'")
