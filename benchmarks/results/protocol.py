"""Sections of many positions on the paper's mesh and on a patient's own: what ``mixpinn simulate`` summed up."""

import shutil
from dataclasses import asdict
from functools import partial
from pathlib import Path

from benchmarks.results.section import REFINED, Data, Section
from mixpinn.base.files import atomic_path, read_json
from mixpinn.dataset import GenerationSummary


def collect(run: Path, images: Path, *, name: str) -> Data:
    """Totals of the run directory of ``mixpinn simulate``, and its picture."""
    with atomic_path(images / f"{name}-poses.png") as temporary:
        shutil.copyfile(run / "poses.png", temporary)
    taught = run / "hybrid.json"
    return {
        "summary": asdict(GenerationSummary.load(run / "summary.json")),
        **({"hybrid": read_json(taught)} if taught.is_file() else {}),
    }


def _taught(data: Data) -> list[str]:
    """What a predictor makes of positions that were left out, where that was measured (``hybrid.json``)."""
    of = data.get("hybrid")
    if of is None:
        return []
    return [
        "A predictor taught on a part of these positions (`mixpinn train DIR --model hybrid --split split.json`; "
        f"`python -m benchmarks.hybrid`), on {of['samples']} samples at positions that it has not seen: MEE "
        f"{of['mee']:.4f} mm (prior {of['prior_mee']:.4f}), rigid {of['rigid_mee']:.4f}, 95th percentile "
        f"{of['mee_p95']:.3f}, worst {of['mee_max']:.3f}; REE {of['ree']:.0e}. From the pose alone "
        f"{of['pose_mee']:.4f} mm, vertebrae within "
        f"{of['vertebra_translation_p95']:.3f} mm and {of['vertebra_rotation_p95_deg']:.3f}° and force within "
        f"{of['force_error_p95']:.1%} at the 95th percentile.\n",
    ]


def _summary(data: Data) -> GenerationSummary:
    values = dict(data["summary"])
    for key in ("min_jacobian", "worst_residual", "peak_penetration", "peak_energy"):
        values[key] = tuple(values[key]) if values[key] is not None else None
    return GenerationSummary(**values)


def render(data: Data, *, name: str, title: str, command: str) -> str:
    """The section."""
    return "\n".join([
        f"## {title}\n", f"Command: {command}\n", _summary(data).markdown(), *_taught(data),
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
        f"{found.wall_seconds / 60.0:.0f} minutes with {found.workers} workers.\n", *_taught(data),
    ])


def section(name: str, title: str, command: str, *, kind: str = "") -> Section:
    """The section of one run."""
    about = {"title": title, "command": command}
    return Section(
        name, partial(collect, name=name), partial(render, name=name, **about), brief=partial(brief, **about),
        kind=kind, help=f"run directory of {command.split('.')[0]}",
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
    kind=REFINED,
)
