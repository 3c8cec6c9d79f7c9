"""``python -m benchmarks.results``: write docs/results.md, its pictures and the README's figures from finished runs.

Every figure on the page is read from what a command has stored; none is typed. Give the run directories of
``make demo`` and ``make patient1``, and, where they exist, the run directory of a whole protocol
(``mixpinn simulate --protocol paper``) and the last lines that the benchmarks printed.
"""

import argparse
import json
import os
import platform
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mixpinn.base.files import atomic_path, read_json, write_text
from mixpinn.dataset import GenerationSummary

ROOT = Path(__file__).parents[1]
PICTURES = ("prediction.png", "error.png")


def processor() -> str:
    """Name of the processor and number of cores."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        name = lines[0].split(":", 1)[1].strip() if lines else name
    return f"{name}, {os.cpu_count()} cores"


def _stages(run: Path) -> str:
    rows = read_json(run / "stage_seconds.json")
    lines = ["| Stage | Wall time [s] |", "| --- | ---: |"]
    lines += [f"| {name} | {seconds:.1f} |" for name, seconds in rows.items()]
    return "\n".join([*lines, f"| **All** | **{sum(rows.values()):.1f}** |"]) + "\n"


def _epochs(run: Path) -> str:
    parts = []
    for folder in sorted((run / "models").iterdir()):
        seconds = [float(row.split(",")[4]) for row in (folder / "history.csv").read_text().splitlines()[1:]]
        parts.append(f"{folder.name}: {len(seconds)} epochs of {sum(seconds) / len(seconds):.1f} s")
    return "; ".join(parts)


def run_section(title: str, command: str, run: Path, images: Path) -> str:
    """One pipeline run: headline, tables of the report, stage times; its pictures are copied beside the page."""
    record = read_json(run / "run.json")
    results = read_json(run / "evaluation" / "results.json")
    quality = read_json(run / "mesh" / "quality.json")
    fidelity = read_json(run / "mesh" / "fidelity.json")["structures"]
    slug = run.name
    for picture in PICTURES:
        if (run / "evaluation" / picture).exists():
            with atomic_path(images / f"{slug}-{picture}") as temporary:
                shutil.copyfile(run / "evaluation" / picture, temporary)
    tables = (run / "evaluation" / "results.md").read_text().split("\n", 3)[3]
    vertebrae = [entry["dice"] for entry in fidelity[1:]]
    return "\n".join([
        f"## {title}\n", f"Command: `{command}`. Run of {record['finished'][:10]}.\n", results["headline"] + "\n",
        f"![Prediction over the finite-element result](images/{slug}-prediction.png)\n",
        f"![Distance between prediction and finite-element result](images/{slug}-error.png)\n",
        f"Mesh: {quality['n_points']:,} points, {quality['n_cells']:,} cells, smallest dihedral angle "
        f"{quality['min_dihedral']:.1f}°, {quality['inverted']} inverted cells; Dice {fidelity[0]['dice']:.3f} for the "
        f"body, {min(vertebrae):.3f} to {max(vertebrae):.3f} for the vertebrae. Training: {_epochs(run)}.\n",
        "### Wall time of each stage\n", _stages(run), tables,
    ])


def short_section(command: str, run: Path) -> str:
    """The README's few figures of a run."""
    stages = read_json(run / "stage_seconds.json")
    results = (run / "evaluation" / "results.md").read_text()
    table = results[results.index("| Model |"):].split("\n\n", 1)[0]
    samples = read_json(run / "simulation" / "summary.json")
    return "\n".join([
        f"`{command}` took {sum(stages.values()) / 60.0:.1f} minutes on {os.cpu_count()} cores, "
        f"{stages['Simulation']:.0f} s of them for {samples['done']} simulated poses with {samples['contact_steps']} "
        "samples. Errors on probe positions that no model has seen:\n", table,
    ])


def fill_readme(path: Path, sections: dict[str, str]) -> None:
    """Replace what stands between the README's markers ``<!-- figures: NAME -->`` and ``<!-- end: NAME -->``."""
    text = path.read_text()
    for name, section in sections.items():
        begin, end = f"<!-- figures: {name} -->", f"<!-- end: {name} -->"
        before, _, rest = text.partition(begin)
        _, _, after = rest.partition(end)
        text = f"{before}{begin}\n{section}\n{end}{after}"
    write_text(path, text)


def protocol_section(run: Path, images: Path) -> str:
    """The whole protocol: the summary that `mixpinn simulate` stored, and its picture."""
    with atomic_path(images / "protocol-poses.png") as temporary:
        shutil.copyfile(run / "poses.png", temporary)
    return "\n".join([
        "## The paper's protocol on the paper's mesh\n",
        "Command: `mixpinn simulate MESH --protocol paper --paper-constants --positions probe_positions.txt --probe "
        "probe_collision.stl`. A smallest det F below zero means that some cell of that mesh was turned inside out, "
        "which the energy does not forbid.\n",
        GenerationSummary.load(run / "summary.json").markdown(),
        "![State of every pose](images/protocol-poses.png)\n",
    ])


def benchmark_section(entries: Sequence[str]) -> str:
    """Benchmarks: NAME=FILE, the file's last line being the JSON that ``python -m benchmarks.NAME`` printed."""
    lines = ["## Speed\n"]
    for entry in entries:
        name, _, path = entry.partition("=")
        values: dict[str, Any] = json.loads(Path(path).read_text().strip().splitlines()[-1])
        lines += [f"### `python -m benchmarks.{name}`\n", "| Figure | Value |", "| --- | ---: |"]
        lines += [
            f"| {key} | {value:.4g} |" if isinstance(value, float) else f"| {key} | {value} |"
            for key, value in values.items() if not isinstance(value, dict | list)
        ]
        lines.append("")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--demo", type=Path, default=ROOT / "runs/demo")
    parser.add_argument("--patient1", type=Path, default=ROOT / "runs/patient1")
    parser.add_argument("--protocol", type=Path)
    parser.add_argument("--benchmark", action="append", default=[], metavar="NAME=FILE")
    parser.add_argument("--out", type=Path, default=ROOT / "docs/results.md")
    options = parser.parse_args(arguments)
    images = options.out.parent / "images"
    sections = [
        "# Results\n",
        f"Written by `python -m benchmarks.results` from finished runs. Machine: {processor()}, no GPU. Errors are in "
        "millimetres, over the samples of probe positions that no model has seen; spread and intervals are explained "
        "below each table.\n",
        run_section("One patient", "make patient1", options.patient1, images),
        run_section("Demo on the phantom", "make demo", options.demo, images),
    ]
    if options.protocol:
        sections.append(protocol_section(options.protocol, images))
    if options.benchmark:
        sections.append(benchmark_section(options.benchmark))
    write_text(options.out, "\n".join(sections))
    fill_readme(ROOT / "README.md", {
        "demo": short_section("make demo", options.demo), "patient1": short_section("make patient1", options.patient1),
    })
    print(options.out)


if __name__ == "__main__":
    main()
