"""Sections of ``make demo`` and ``make patient1``, also on linear cells: headline, times, tables of the report."""

import shutil
from functools import partial
from pathlib import Path

from benchmarks.results.section import OWN_SOLVER, REFINED, Data, Section, table
from mixpinn.base.files import atomic_path, read_json

ROOT = Path(__file__).parents[2]
LINEAR = "patient1-linear"
PICTURES = ("prediction.png", "error.png")


def _training(run: Path) -> str:
    parts = []
    for folder in sorted(path.parent for path in (run / "models").glob("*/history.csv")):
        seconds = [float(row.split(",")[4]) for row in (folder / "history.csv").read_text().splitlines()[1:]]
        parts.append(f"{folder.name}: {len(seconds)} epochs of {sum(seconds) / len(seconds):.1f} s")
    return "; ".join(parts)


def collect(run: Path, images: Path, *, name: str) -> Data:
    """Figures and pictures of a finished pipeline run."""
    for picture in PICTURES:
        if (run / "evaluation" / picture).exists():
            with atomic_path(images / f"{name}-{picture}") as temporary:
                shutil.copyfile(run / "evaluation" / picture, temporary)
    quality = read_json(run / "mesh" / "quality.json")
    fidelity = read_json(run / "mesh" / "fidelity.json")["structures"]
    rigid = [entry["dice"] for entry in fidelity[1:]]
    summary = read_json(run / "simulation" / "summary.json")
    return {
        "run": read_json(run / "run.json")["finished"][:10],
        "headline": read_json(run / "evaluation" / "results.json")["headline"],
        "mesh": f"{quality['n_points']:,} points, {quality['n_cells']:,} cells, smallest dihedral angle "
        f"{quality['min_dihedral']:.1f}°, {quality['inverted']} inverted cells; Dice {fidelity[0]['dice']:.3f} for the "
        f"body, {min(rigid):.3f} to {max(rigid):.3f} for the vertebrae",
        "training": _training(run), "stage_seconds": _seconds(run / "stage_seconds.json"),
        "poses": summary["done"], "samples": summary["contact_steps"],
        "tables": (run / "evaluation" / "results.md").read_text().split("\n", 3)[3],
    }


def _seconds(path: Path) -> dict[str, float]:
    """Wall time of each stage [s]; a checksum beside them is no stage."""
    return {stage: seconds for stage, seconds in read_json(path).items() if isinstance(seconds, float)}


def render(data: Data, *, name: str, title: str, command: str) -> str:
    """The section."""
    stages = data["stage_seconds"]
    rows = [(stage, f"{seconds:.1f}") for stage, seconds in stages.items()]
    return "\n".join([
        f"## {title}\n", f"Command: `{command}`. Run of {data['run']}.\n", data["headline"] + "\n",
        f"![Prediction over the finite-element result](images/{name}-prediction.png)\n",
        f"![Distance between prediction and finite-element result](images/{name}-error.png)\n",
        f"Mesh: {data['mesh']}. Training: {data['training']}.\n", "### Wall time of each stage\n",
        table(("Stage", "Wall time [s]"), [*rows, ("**All**", f"**{sum(stages.values()):.1f}**")]), data["tables"],
    ])


def brief(data: Data, *, name: str, title: str, command: str) -> str:
    """The section in short: the headline, one picture, the models beside each other."""
    return "\n".join([
        f"## {title}\n", data["headline"] + "\n",
        f"![Prediction over the finite-element result](images/{name}-prediction.png)\n", f"Mesh: {data['mesh']}.\n",
        short(data, command=command) + "\n",
    ])


def headline(data: Data, *, title: str, command: str) -> str:
    """The section in one paragraph."""
    return "\n".join([f"## {title}\n", f"{data['headline']} {timing(data, command=command)}\n"])


def short(data: Data, *, command: str) -> str:
    """The few figures of a run that the README shows."""
    tables = data["tables"]
    models = tables[tables.index("| Model |"):].split("\n\n", 1)[0]
    return "\n".join([f"{timing(data, command=command)} Errors on probe positions that no model has seen:\n", models])


def timing(data: Data, *, command: str) -> str:
    """How long a run took, in a sentence."""
    stages, cores = data["stage_seconds"], data["machine"].rpartition(", ")[2]
    return (
        f"`{command}` took {sum(stages.values()) / 60.0:.1f} minutes on {cores}, {stages['Simulation']:.0f} s of them "
        f"for {data['poses']} simulated poses with {data['samples']} samples."
    )


def section(name: str, title: str, command: str) -> Section:
    """The section of a pipeline run."""
    return Section(
        name, partial(collect, name=name), partial(render, name=name, title=title, command=command),
        brief=partial(headline, title=title, command=command) if name in (LINEAR, "demo")
        else partial(brief, name=name, title=title, command=command), kind=OWN_SOLVER if name == LINEAR else REFINED,
        help=f"run directory of '{command}'", default=ROOT / "runs" / name,
    )


PATIENT1 = section("patient1", "One patient", "make patient1")
PATIENT1_LINEAR = section(LINEAR, "The same patient on linear cells", f"make patient1 CONFIG=configs/{LINEAR}.toml")
DEMO = section("demo", "Demo on the phantom", "make demo")
