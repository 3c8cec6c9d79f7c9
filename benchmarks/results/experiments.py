"""Section of the paper's experiments: what ``mixpinn ablate`` trained and tested, beside the paper's tables."""

import shutil
from pathlib import Path
from typing import Any

from benchmarks.results.section import OWN_SOLVER, Data, Section
from mixpinn.base.files import atomic_path, read_json
from mixpinn.evaluation import Table

PICTURES = ("rows.png", "hold-outs.png", "data-need.png")
TITLES = {
    "rows.png": "MEE, rigid MEE and REE of every row", "hold-outs.png": "What no model has seen",
    "data-need.png": "Error against the number of training positions",
}


def collect(entries: list[str], images: Path) -> Data:
    """The table's run directory, and after it further ones that explain it, as ``WHAT IS OTHER=DIR``."""
    run, *further = entries
    data = _kept(Path(run))
    data["pictures"] = []
    for picture in PICTURES:
        if (Path(run) / picture).exists():
            data["pictures"].append(picture)
            with atomic_path(images / f"experiments-{picture}") as temporary:
                shutil.copyfile(Path(run) / picture, temporary)
    data["further"] = {}
    for entry in further:
        name, _, folder = entry.rpartition("=")
        data["further"][name] = _kept(Path(folder))
    return data


def _kept(run: Path) -> Data:
    found = read_json(run / "results.json")
    return {
        "run": read_json(run / "run.json")["started"][:10],
        **{key: found[key] for key in ("protocol", "diameters", "nodes", "test_sets", "tables")},
    }


def table_of(stored: dict[str, Any]) -> Table:
    """A table as it was stored."""
    return Table(
        stored["title"], tuple(stored["columns"]), tuple(tuple(row) for row in stored["rows"]), stored["note"],
    )


def render(data: Data) -> str:
    """The section: ours beside the paper's first, then claims, hold-outs, data need and budgets."""
    tables = {stored["title"]: table_of(stored) for stored in data["tables"]}
    first = [name for name in ("Ours beside the paper's", "The paper's claims") if name in tables]
    rest = [name for name in tables if name not in first]
    shown = [f"![{TITLES[name]}](images/experiments-{name})\n" for name in data["pictures"]]
    lines = [
        "## The paper's experiments, on a desk\n",
        f"Command: `mixpinn ablate LABELMAPS --protocol desk`. Run of {data['run']} on {data['machine']}. "
        f"{data['protocol']}\n",
        *_words(tables), *(tables[name].markdown() for name in first), *shown,
        *(tables[name].markdown() for name in rest),
    ]
    if data["further"]:
        lines.append("### Experiments beside the table\n")
        lines.append(
            "Single settings changed, the rest as above: what could explain where the table and the paper part.\n",
        )
        lines.append("\n".join(
            f"- {name}: {'; '.join(_in_short(table_of(entry)))}." for name, other in data["further"].items()
            for entry in other["tables"] if entry["title"] == "The paper's claims"
        ) + "\n")
    for name, other in data["further"].items():
        kept = [
            table_of(stored) for stored in other["tables"]
            if stored["title"] in ("The paper's claims", "Test set “test”")
        ]
        lines += [f"#### {name}\n", other["protocol"] + "\n", *(
            part.markdown().replace("### ", "##### ", 1) for part in kept
        )]
    return "\n".join(lines)


def brief(data: Data) -> str:
    """The section in short: the claims in words, ours beside the paper's."""
    tables = {stored["title"]: table_of(stored) for stored in data["tables"]}
    beside = "Ours beside the paper's"
    return "\n".join([
        "## The paper's experiments, on a desk\n",
        f"Command: `mixpinn ablate LABELMAPS --protocol desk`. Run of {data['run']} on {data['machine']}. "
        f"{data['protocol']}\n",
        *_words(tables), *([tables[beside].markdown()] if beside in tables else []),
        *(f"![{TITLES[name]}](images/experiments-{name})\n" for name in data["pictures"][:1]),
    ])


def _words(tables: dict[str, Table]) -> list[str]:
    """The claims in plain words."""
    claims = tables.get("The paper's claims")
    if claims is None:
        return []
    lines = [
        f"- *{claim}*: {_verdict([row for row in claims.rows if row[0] == claim])}"
        for claim in dict.fromkeys(row[0] for row in claims.rows)
    ]
    return [
        "What the paper claims, at this scale (from the table of claims):\n", "\n".join(lines) + "\n",
        "The networks here are an eighth as wide as the paper's, see coarser fields of another solver and train for a "
        "fraction of its budget: compare rows with rows, not with the paper's figures. "
        "*Elastic prior*, which needs no training, stands in every table.\n",
    ]


def _in_short(claims: Table) -> list[str]:
    """Each comparison in a few words."""
    return [
        f"{row[0]} ({row[1]}): {float(row[2] or 0.0):.3f} against {float(row[3] or 0.0):.3f} mm, ratio "
        f"{float(row[4] or 0.0):.2f}" for row in claims.rows
    ]


def _verdict(rows: list[tuple[Any, ...]]) -> str:
    """Whether a claim shows, from its rows in the table of claims."""
    ratios = [float(row[4]) for row in rows]
    shown, right = sum(row[6] == "yes" for row in rows), sum(ratio > 1.0 for ratio in ratios)
    listed = ", ".join(f"{ratio:.2f}" for ratio in ratios)
    if shown == len(rows):
        return f"shows in all {shown} comparisons (ratios {listed})."
    weak = f"; the direction is right in {right}, the effect weaker than asked" if right > shown else ""
    begin = "does not show in any" if not shown else f"shows in {shown}"
    return f"{begin} of {len(rows)} comparisons{weak} (ratios {listed})."


EXPERIMENTS = Section(
    "ablation", collect, render, brief=brief, kind=OWN_SOLVER, metavar="[WHAT=]DIR", several=True,
    help="run directory of 'mixpinn ablate'; given again as WHAT=DIR for runs with another setting beside it",
)
