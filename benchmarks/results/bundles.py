"""Section of predictors that ``mixpinn onboard`` made of several anatomies: how near, and whether to be leaned on."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.results.section import REFINED, Data, Section, table
from mixpinn.base.files import read_json

FILES = ("hybrid", "dependability", "latency")
"""Last lines of the benchmarks of these names, kept beside a bundle as ``NAME.json``."""


def collect(given: Sequence[str], images: Path) -> Data:
    """Figures of run directories given as ``NAME=DIR``."""
    found: dict[str, Any] = {}
    for word in given:
        name, _, folder = word.partition("=")
        run = Path(folder)
        rounds = read_json(run / "rounds.json")["rounds"]
        entry: dict[str, Any] = {
            "poses": sum(part.get("poses", 0) for part in rounds), "minutes": rounds[-1]["minutes"],
            "last_round": {key: rounds[-1][key] for key in ("prior_mee", "model_mee", "no_motion")},
        }
        for kind in FILES:
            path = run / f"{kind}.json"
            entry[kind] = read_json(path) if path.is_file() else None
        found[name] = entry
    return {"bundles": found}


def _cell(values: dict[str, Any] | None, key: str, form: str = ".4f") -> str:
    value = None if values is None else values.get(key)
    if value is None:
        return "–"
    if isinstance(value, dict):
        return " / ".join(format(part, form) for part in value.values())
    return str(len(value)) if isinstance(value, list) else format(value, form)


def _accuracy(bundles: dict[str, Any]) -> str:
    return table(
        ("Anatomy", "Poses", "No motion [mm]", "Prior [mm]", "Predictor: MEE [mm]", "Rigid [mm]",
         "From the pose: MEE [mm]", "Worst [mm]", "Force, 95th percentile"),
        [(
            name, entry["poses"], f"{entry['last_round']['no_motion']:.2f}", f"{entry['last_round']['prior_mee']:.4f}",
            _cell(entry["hybrid"] or {"mee": entry["last_round"]["model_mee"]}, "mee"),
            _cell(entry["hybrid"], "rigid_mee"), _cell(entry["dependability"], "pose_mee", ".3f"),
            _cell(entry["dependability"], "pose_mee_max", ".2f"),
            _cell(entry["hybrid"], "force_error_p95", ".1%"),
        ) for name, entry in bundles.items()],
    )


def _trust(bundles: dict[str, Any]) -> str:
    return table(
        ("Anatomy", "Answers", "Answered", "Unconverged / absurd / jumps / dips", "Nonsense passed", "Threads differ",
         "Coverage: field / force / motion", "Sharpness"),
        [(
            name, _cell(of, "answers", ""), _cell(of, "answered", ".1%"),
            " / ".join(_cell(of, key, "") for key in ("unconverged", "absurd", "jumps", "dips")),
            _cell(of, "nonsense_passed", ""), _cell(of, "thread_differences", ""), _cell(of, "bound_coverage", ".2f"),
            _cell(of, "bound_sharpness", ".1f"),
        ) for name, of in ((name, entry["dependability"]) for name, entry in bundles.items()) if of is not None],
    )


_TIMES = {
    "All nodes": "all_nodes", "Contact → all [ms]": "contact_ms_p50", "99th percentile": "contact_ms_p99",
    "Contact → 5,000 nodes [ms]": "outputs_ms_p50", "Pose [ms]": "pose_ms_p50", "99th percentile ": "pose_ms_p99",
    "Pose, one thread [ms]": "one_thread_pose_ms_p50", "Pose beside a busy process, 99th percentile [ms]":
    "busy_pose_ms_p99", "Growth on a finer mesh": "growth", "Bundle [MB]": "bundle_mb",
}


def _times(bundles: dict[str, Any]) -> list[str]:
    """How long answers take, where it was measured."""
    timed = {name: entry["latency"] for name, entry in bundles.items() if entry["latency"] is not None}
    if not timed:
        return []
    finer = next((of["finer_nodes"] for of in timed.values() if of.get("finer_nodes")), None)
    words = "" if finer is None else (
        " *Growth*: the median time from contact to the same 5,000 nodes on a finer mesh of the same facets "
        f"({finer:,} nodes), relative to that on the first."
    )
    return [
        "One answer at a time, idle (`python -m benchmarks.latency BUNDLE [FINER_BUNDLE]`)." + words + "\n",
        table(("Anatomy", *_TIMES), [
            (name, *(_cell(of, key, ",d" if key == "all_nodes" else ".2f") for key in _TIMES.values()))
            for name, of in timed.items()
        ]),
    ]


def render(data: Data) -> str:
    """The section."""
    return "\n".join([
        brief(data), *_times(data["bundles"]),
        "Random presses from first touch to 20 mm, tilted by up to 15°, each answer asked for on its own:\n",
        _trust(data["bundles"]),
    ])


def brief(data: Data) -> str:
    """The section in short."""
    return "\n".join([
        "## Predictors of several anatomies\n",
        "`mixpinn onboard` without further options than named; errors on the poses of the last round, which nothing "
        "was learned from. Commands: `python -m benchmarks.hybrid BUNDLE`, `python -m benchmarks.dependability "
        "BUNDLE`.\n",
        _accuracy(data["bundles"]),
    ])


BUNDLES = Section(
    "bundles", collect, render, brief=brief, kind=REFINED, metavar="NAME=DIR",
    help="run directory of 'mixpinn onboard', with what benchmarks found of its bundle beside it",
    several=True,
)
