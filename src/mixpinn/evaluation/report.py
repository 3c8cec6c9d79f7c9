"""The report of a run: one self-contained HTML page, and the same figures as JSON, CSV and Markdown."""

import base64
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.files import write_json, write_text
from mixpinn.evaluation.budget_page import budget_tables
from mixpinn.evaluation.evaluate import ZeroModel
from mixpinn.evaluation.metrics import AS_PUBLISHED
from mixpinn.evaluation.plots import error_against_depth, error_by_part, error_distribution, figure_png, loss_curves
from mixpinn.evaluation.rendering import Picture
from mixpinn.evaluation.statistics import depth_profile, summarise, summarise_metrics, summarise_parts
from mixpinn.evaluation.table import Table
from mixpinn.evaluation.tables import depth_table, part_table, results_table, runtime_table, spread_table
from mixpinn.records import Evaluation
from mixpinn.records.error_budget import ErrorBudget

LIMITS = (
    "The reference is a finite-element simulation and not a measurement on a patient: whatever the simulation gets "
    "wrong about real tissue comes on top of every error given here.",
    "One anatomy, one probe, one set of material constants. A model is tied to the mesh that it was trained on; "
    "another patient needs a run of its own.",
    "The models are told the true displacement of the points that touch the probe. In use it has to come from a "
    "tracked probe, and its error adds to theirs.",
    "Means hide places: a single point may be off by far more than the mean, above all near the probe and at the "
    "deepest steps. Look at the worst sample and at the error map before you rely on a figure.",
    "The 95 % intervals say how much the mean depends on the choice of probe positions. They do not cover other "
    "training runs, anatomies or materials.",
    "Times hold for the machine and the number of threads that they were measured with.",
)
"""What holds for every run: what the figures do and do not say."""


@dataclass(frozen=True, eq=False)
class ReportContent:
    """What a report shows; whatever is empty is left out.

    Attributes:
        title: of the page.
        evaluations: one a model, all on the same samples; `ZeroModel`'s is what the headline compares with.
        introduction: a paragraph on what was done, in plain words.
        discretisation: elements and mesh of the simulations, which every error refers to.
        mesh: statistics of the mesh (`mesh_table`).
        dataset: statistics of the samples (`dataset_counts_table`).
        setup: tables on what was simulated and how well: mesh quality, fidelity to the label map, convergence.
        protocol: name of a setting (constants, probe path, contact rule, split) to its value.
        loss_logs: model to its CSV of losses.
        pictures: what was rendered.
        picture_note: why pictures are missing.
        stage_seconds: stage to its wall time [s].
        fem_seconds: mean time of one step of the finite-element solver [s].
        provenance: versions, seeds and hashes, by group.
        budget: how far answers are from the converged solution.
        limits: what the figures do and do not say; those special to this run come before `LIMITS`.
        with_paper: show the paper's rows, where its set-up is the one that was simulated.
        seed: of the bootstrap.
    """

    title: str
    evaluations: tuple[Evaluation, ...]
    introduction: str = ""
    discretisation: str = ""
    mesh: Table | None = None
    dataset: Table | None = None
    setup: tuple[Table, ...] = ()
    protocol: Mapping[str, str] = field(default_factory=dict)
    loss_logs: Mapping[str, Path] = field(default_factory=dict)
    pictures: tuple[Picture, ...] = ()
    picture_note: str = ""
    stage_seconds: Mapping[str, float] = field(default_factory=dict)
    fem_seconds: float | None = None
    provenance: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    budget: ErrorBudget | None = None
    limits: tuple[str, ...] = ()
    with_paper: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Headline:
    """The run in few figures.

    Attributes:
        sentence: in plain words.
        cards: value and what it is, for the top of the page.
    """

    sentence: str
    cards: tuple[tuple[str, str], ...]


def write_report(folder: Path | str, content: ReportContent) -> Path:
    """Write ``report.html``, ``results.json``, ``results.csv`` and ``results.md`` into `folder`.

    Returns:
        Path of the HTML page, which needs no other file and no network.

    Raises:
        InputError: there is nothing to report, or a picture or log is missing.
    """
    if not content.evaluations:
        raise InputError("report", expected="at least one evaluated model", got="none", fix="run 'mixpinn evaluate'")
    folder = Path(folder)
    headline, tables, details = summarise_run(content), _result_tables(content), _detail_tables(content)
    setup = [*(table for table in (content.mesh, content.dataset) if table is not None), *content.setup]
    stages = _stage_table(content)
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )
    page = environment.get_template("report.html.j2").render(
        content=content, headline=headline, tables=tables, details=details, setup=setup, stages=stages,
        limits=(*content.limits, *LIMITS), plots=_plots(content), budget=budget_tables(content.budget),
        pictures=[(_data_uri(_read(picture.path)), picture.caption) for picture in content.pictures],
    )
    # Everything is made before anything is written.
    write_json(folder / "results.json", {"headline": headline.sentence, **_results(content)})
    write_text(folder / "results.csv", details[0].csv())
    total = [] if content.budget is None else [content.budget.sentence + "\n"]
    write_text(folder / "results.md", "\n".join([
        f"## {content.title}\n", headline.sentence + "\n", *total,
        *(table.markdown() for table in [
            *tables, *budget_tables(content.budget), *setup, *([stages] if stages else []), *details,
        ]),
    ]))
    write_text(folder / "report.html", page)
    return folder / "report.html"


def summarise_run(content: ReportContent) -> Headline:
    """Say in plain words how good the best model is and how much better than predicting no motion."""
    generator = np.random.default_rng(content.seed)
    learned = [e for e in content.evaluations if e.model != ZeroModel.name] or list(content.evaluations)
    best = min(learned, key=lambda e: float(e.metrics["mee"].mean()))
    error = summarise(best.metrics["mee"], best.about["position"], generator=generator)
    moved = float(best.metrics["mean_displacement"].mean()) if "mean_displacement" in best.metrics else None
    # One position alone says nothing about others: it has no interval.
    several = error.n_positions > 1
    places = f"{error.n_positions:,} probe positions" if several else "one probe position"
    interval = f"95 % interval {_round(error.low)} to {_round(error.high)} mm; " if several else ""
    cards = [(f"{_round(error.mean)} mm", f"mean error of {best.model}")]
    sentence = (
        f"On {error.n_samples:,} simulated situations at {places} (split “{best.split}”), "
        f"{best.model} predicts the position of each point of the body to {_round(error.mean)} mm on average "
        f"({interval}95 % of the situations stay below "
        f"{_round(error.p95)} mm, the worst reaches {_round(error.maximum)} mm)."
    )
    if moved is not None and best.model != ZeroModel.name:
        ratio = moved / error.mean if error.mean > 0.0 else np.inf
        sentence += f" The points move by {_round(moved)} mm on average, so the model is "
        if ratio > 1.0:
            sentence += f"{_round(ratio)} times better than predicting no motion."
            cards.append((f"{_round(ratio)}×", "better than predicting no motion"))
        else:
            sentence += "no better than predicting no motion."
            cards.append(("none", "gain over predicting no motion"))
    others = ", ".join(
        f"{e.model} {_round(float(e.metrics['mee'].mean()))} mm" for e in learned if e is not best
    )
    if others:
        sentence += f" Mean errors for comparison: {others}."
    cards.append((f"{_round(error.p95)} mm", "below this in 95 % of situations"))
    if content.budget is not None:
        total = content.budget.total
        cards.append((f"{100.0 * total.force:.0f} %", "of the force may be wrong, against the converged solution"))
        cards.append((f"{100.0 * total.motion:.0f} %", "of the motions, likewise"))
    if len(best.seconds):
        milliseconds = float(np.median(best.seconds)) * 1e3
        sentence += f" One prediction takes {_round(milliseconds)} ms"
        cards.append((f"{_round(milliseconds)} ms", "for one prediction"))
        if content.fem_seconds is not None:
            sentence += (
                f", against {_round(content.fem_seconds * 1e3)} ms for one step of the finite-element simulation"
            )
        sentence += "."
    return Headline(sentence, tuple(cards))


def _result_tables(content: ReportContent) -> list[Table]:
    models = content.evaluations
    published = any(name.endswith(AS_PUBLISHED) for evaluation in models for name in evaluation.metrics)
    tables = [results_table(models, with_paper=content.with_paper and not published)]
    if published:
        tables.append(results_table(models, with_paper=content.with_paper, as_published=True))
    tables.append(part_table(models))
    if content.fem_seconds is not None or any(len(evaluation.seconds) for evaluation in models):
        tables.append(runtime_table(models, fem_seconds=content.fem_seconds, with_paper=content.with_paper))
    return tables


def _detail_tables(content: ReportContent) -> list[Table]:
    generator = np.random.default_rng(content.seed)
    return [spread_table(content.evaluations, generator=generator), depth_table(content.evaluations)]


def _results(content: ReportContent) -> dict[str, Any]:
    generator = np.random.default_rng(content.seed)
    models = []
    for evaluation in content.evaluations:
        profile, times = depth_profile(evaluation), evaluation.seconds * 1e3
        models.append({
            "model": evaluation.model, "split": evaluation.split,
            "metrics": {k: asdict(v) for k, v in summarise_metrics(evaluation, generator=generator).items()},
            "mee_by_part": {k: asdict(v) for k, v in summarise_parts(evaluation, generator=generator).items()},
            "mee_by_depth": asdict(profile),
            "milliseconds": {"mean": times.mean(), "median": np.median(times)} if len(times) else {},
            "notes": evaluation.notes,
        })
    return {
        "title": content.title, "models": models, "protocol": dict(content.protocol),
        "budget": None if content.budget is None else asdict(content.budget),
        "stage_seconds": dict(content.stage_seconds), "fem_seconds": content.fem_seconds,
        "provenance": {group: dict(values) for group, values in content.provenance.items()},
    }


def _stage_table(content: ReportContent) -> Table | None:
    if not content.stage_seconds:
        return None
    stages = {**content.stage_seconds, "Total": sum(content.stage_seconds.values())}
    return Table("Time of each stage", ("Stage", "Time"), tuple((k, _duration(v)) for k, v in stages.items()))


def _plots(content: ReportContent) -> list[tuple[str, str]]:
    models = content.evaluations
    figures = [
        (error_against_depth(models), "Error against indentation depth."),
        (error_distribution(models), "Distribution of the error over the samples."),
        (error_by_part(models), "Mean error of the soft tissue and of each rigid part."),
    ]
    if content.loss_logs:
        losses = loss_curves(content.loss_logs, models=[evaluation.model for evaluation in models])
        figures.append((losses, "Loss while training; dotted lines mark drops of the learning rate."))
    return [(_data_uri(figure_png(figure)), caption) for figure, caption in figures]


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(str(path), expected="a picture", got="no such file", fix="render it again") from error


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _round(value: float) -> str:
    """Two significant digits, whole numbers from ten on."""
    return f"{value:,.0f}" if value >= 10.0 else f"{value:#.2g}"


def _duration(seconds: float) -> str:
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"
