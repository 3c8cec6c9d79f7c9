"""Section of the paper's whole protocol on the paper's mesh: what ``mixpinn simulate`` summed up."""

import shutil
from dataclasses import asdict
from pathlib import Path

from benchmarks.results.section import Data, Section
from mixpinn.base.files import atomic_path
from mixpinn.dataset import GenerationSummary


def collect(run: Path, images: Path) -> Data:
    """Totals of the run directory of ``mixpinn simulate``, and its picture."""
    with atomic_path(images / "protocol-poses.png") as temporary:
        shutil.copyfile(run / "poses.png", temporary)
    return {"summary": asdict(GenerationSummary.load(run / "summary.json"))}


def render(data: Data) -> str:
    """The section."""
    values = dict(data["summary"])
    for key in ("min_jacobian", "worst_residual", "peak_penetration", "peak_energy"):
        values[key] = tuple(values[key]) if values[key] is not None else None
    return "\n".join([
        "## The paper's protocol on the paper's mesh\n",
        "Command: `mixpinn simulate MESH --protocol paper --paper-constants --positions probe_positions.txt --probe "
        "probe_collision.stl`. A smallest det F below zero means that some cell of that mesh was turned inside out, "
        "which the energy does not forbid.\n",
        GenerationSummary(**values).markdown(), "![State of every pose](images/protocol-poses.png)\n",
    ])


PROTOCOL = Section("protocol", collect, render, help="run directory of 'mixpinn simulate --protocol paper'")
