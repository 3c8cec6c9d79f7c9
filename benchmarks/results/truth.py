"""Section of the discretisations: forces with linear and quadratic cells, and how far they are from converged."""

import json
from pathlib import Path

from benchmarks.results.section import Data, Section, table

DEPTHS = ("5 mm", "10 mm", "15 mm", "20 mm")
BASE = ("linear", "linear halved", "quadratic", "quadratic halved")
POSES = tuple(f"({place}), {turn}°" for place in ("30, 133, −55", "50, 133, −15", "50, 133, 25") for turn in (0, 90))


def collect(entries: list[str], images: Path) -> Data:
    """From ``WORDS=FILE`` entries: the mesh in words, and what ``python -m benchmarks.truth`` printed for it."""
    meshes = {}
    for entry in entries:
        words, _, path = entry.partition("=")
        meshes[words] = json.loads(Path(path).read_text(encoding="utf-8").strip().splitlines()[-1])
    return {"meshes": meshes}


def levels(named: Data) -> list[str]:
    """The cells that there are figures for: the mesh as it is, edges under the probe, what pairs of them tend to."""
    finer = [level for level in named if level not in BASE]
    finer.sort(key=lambda level: ("extrapolated" in level, -float(level.split()[2]), len(level)))
    return [level for level in BASE if level in named] + finer


def forces(values: Data) -> str:
    """Probe forces of every level and pose that were solved."""
    rows = [
        (POSES[int(number)], level, *(f"{force:.2f}" for force in (*reached, *[float("nan")] * 4)[:4]))
        for number in map(str, range(len(POSES))) for level in levels(values["forces"])
        for reached in [values["forces"].get(level, {}).get(number)] if reached
    ]
    text = table(("Position, rotation", "Cells", *DEPTHS), rows, numeric_from=2)
    return text.replace("| nan ", "| – ")


def border(values: Data) -> str:
    """What cells along the border of the held skin tend to beyond the mesh as it is."""
    more, unsure = values.get("border", {"poses": 0}), values.get("border_uncertainty", {})
    if not more["poses"]:
        return ""
    return (
        ". Where the skin stops being held, cells made finer to edges of 12 and 6 mm, and extrapolated with order 1, "
        f"change the force by up to {100 * more['force']:.1f} %, a vertebra's motion by {more['vertebra_mm']:.3f} mm "
        f"and the mean field by {more['field_mm']:.3f} mm (solved for {more['poses']:.0f} pose(s), there part of the "
        f"reference); edges of 6 mm alone are {100 * unsure['force']:.1f} %, {unsure['vertebra_mm']:.3f} mm and "
        f"{unsure['field_mm']:.3f} mm off that"
    )


def besides(values: Data) -> str:
    """What halving every edge besides changes."""
    rest = values.get("halved", {"poses": 0})
    if not rest["poses"]:
        return ""
    return (
        f". Halving all other edges besides changes the force by up to {100 * rest['force']:.1f} %, a vertebra's "
        f"motion by {rest['vertebra_mm']:.3f} mm and the mean field by {rest['field_mm']:.3f} mm (solved for "
        f"{rest['poses']:.0f} pose(s), not part of the reference)"
    )


def errors(values: Data) -> str:
    """Errors against the extrapolated solution, where there is one."""
    if not values["rows"]:
        return "No converged solution on these facets yet.\n"
    rows = [
        (level, f"{100 * row['force']:.1f}", f"{row['vertebra_mm']:.3f}", f"{row['vertebra_bar']:.2f}",
         f"{row['field_mm']:.3f}", f"{row['poses']:.0f}")
        for level in levels(values["rows"]) for row in [values["rows"][level]]
    ]
    unsure = values["uncertainty"]
    doubt = "" if unsure.get("force") is None else (
        f"; the next pair of lengths tends to values up to {100 * unsure['force']:.1f} % of the force and "
        f"{unsure['vertebra_mm']:.3f} mm of a vertebra's motion away from it, its uncertainty"
    )
    doubt += border(values) + besides(values)
    tool = f" with the {values['probe']}, order {values['order']:g}" if "probe" in values else ""
    tool += f", joints {values['joints']}" if values.get("joints", "none") != "none" else ""
    return (
        f"Against {values['reference']}{tool}, over {values['poses']} pose(s){doubt}:\n\n"
        + table(("Cells", "Force [%]", "Vertebra [mm]", "of its bar", "Field, mean [mm]", "Poses"), rows)
    )


def render(data: Data) -> str:
    """The section."""
    lines = [
        "## How far the solver is from the converged solution\n",
        "Command: `python -m benchmarks.truth --mesh MESH` on patient1, tissue constants of the paper, forces in N; "
        "*halved* is the same mesh with every edge halved; *edges of h mm* are quadratic cells refined under the probe "
        "until no edge there is longer; *held border* is the line where skin stops being held; all on the same facets. "
        "The error falls with a power of h that the tool's edges decide, so that two lengths tell what they tend to. A "
        "dash is a depth that was not reached. Errors are the largest over depths and poses; a vertebra's bar is 2 % "
        "of its motion or 0.05 mm, whichever is larger.\n",
    ]
    for words, values in data["meshes"].items():
        lines += [f"### {words}\n", errors(values), forces(values)]
    return "\n".join(lines)


def brief(data: Data) -> str:
    """The section in short."""
    lines, stiffer = ["## How far the solver is from the converged solution\n"], []
    for words, values in data["meshes"].items():
        ratios = [
            a / b for number, linear in values["forces"].get("linear", {}).items()
            for a, b in zip(linear, values["forces"].get("quadratic", {}).get(number, []), strict=False)
        ]
        if ratios and not values["rows"]:
            stiffer.append(f"{min(ratios):.2f} to {max(ratios):.2f} times ({words})")
        if values["rows"]:
            rows, unsure = values["rows"], values["uncertainty"].get("force")
            lines.append(
                f"- {words}, against {values['reference']} ({values['poses']} poses): force off by "
                + ", ".join(f"{100 * rows[level]['force']:.0f} % ({level})" for level in levels(rows))
                + ("." if unsure is None else f"; that solution is uncertain by {100 * unsure:.0f} %.")
            )
    if stiffer:
        lines.append(f"- Linear cells press back {', '.join(stiffer)} as hard as quadratic ones on the same mesh.")
    return "\n".join(lines) + "\n"


TRUTH = Section(
    "truth", collect, render, brief=brief, kind="against the converged solution of the mesh's own geometry",
    metavar="WORDS=FILE", help="output of benchmarks.truth for a mesh in words; repeatable", several=True,
)
