"""Sections of many positions on the paper's mesh and on a patient's own: what ``mixpinn simulate`` summed up."""

import shutil
from dataclasses import asdict
from functools import partial
from pathlib import Path

from benchmarks.results.section import Data, Section
from mixpinn.base.files import atomic_path
from mixpinn.dataset import GenerationSummary


def collect(run: Path, images: Path, *, name: str) -> Data:
    """Totals of the run directory of ``mixpinn simulate``, and its picture."""
    with atomic_path(images / f"{name}-poses.png") as temporary:
        shutil.copyfile(run / "poses.png", temporary)
    return {"summary": asdict(GenerationSummary.load(run / "summary.json"))}


def _summary(data: Data) -> GenerationSummary:
    values = dict(data["summary"])
    for key in ("min_jacobian", "worst_residual", "peak_penetration", "peak_energy"):
        values[key] = tuple(values[key]) if values[key] is not None else None
    return GenerationSummary(**values)


def render(data: Data, *, name: str, title: str, command: str) -> str:
    """The section."""
    return "\n".join([
        f"## {title}\n", f"Command: {command}\n", _summary(data).markdown(),
        f"![State of every pose](images/{name}-poses.png)\n",
    ])


def brief(data: Data, *, title: str, command: str) -> str:
    """The section in short."""
    found = _summary(data)
    smallest = "not told" if found.min_jacobian is None else f"{found.min_jacobian[0]:.3g}"
    return "\n".join([
        f"## {title}\n", f"Command: {command}\n",
        f"{found.done} poses done and {found.failed} failed, {found.steps:,} steps, {found.failed_steps} of them "
        f"without equilibrium, {found.contact_steps:,} samples; smallest det F {smallest}. "
        f"{found.wall_seconds / 60.0:.0f} minutes with {found.workers} workers.\n",
    ])


def section(name: str, title: str, command: str) -> Section:
    """The section of one run."""
    about = {"title": title, "command": command}
    return Section(
        name, partial(collect, name=name), partial(render, name=name, **about), brief=partial(brief, **about),
        help=f"run directory of {command.split('.')[0]}",
    )


PROTOCOL = section(
    "protocol", "The paper's protocol on the paper's mesh",
    "`mixpinn simulate MESH --protocol paper --paper-constants --positions probe_positions.txt --probe "
    "probe_collision.stl`. A smallest det F below zero means that some cell of that mesh was turned inside out, which "
    "the energy does not forbid.",
)
OWN_PROTOCOL = section(
    "own-protocol", "132 positions on the patient's own mesh, refined under the probe",
    "`mixpinn simulate MESH --positions probe_positions.txt --joints in-vivo-prone --set 'protocol.rotations=[0.0]' "
    "--set refinement.edge=10`, on the mesh that `mixpinn onboard` makes. Smallest det F is that of the cells that "
    "were solved on.",
)
