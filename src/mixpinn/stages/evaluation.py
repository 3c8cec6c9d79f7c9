"""The evaluation stage: a store and trained models in, metrics, pictures and the report out."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from mixpinn.anatomy.mixture import mixed_parts
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.base.rundir import finish_run, is_finished, run_scope, start_run, versions
from mixpinn.dataset import GenerationSummary, SimulationStore, Split, dataset_table, held_out_samples
from mixpinn.evaluation import (
    Candidate,
    Case,
    Picture,
    ReportContent,
    Table,
    ZeroModel,
    dataset_counts_table,
    evaluate,
    mesh_table,
    render_pictures,
    typical_sample,
    write_report,
)
from mixpinn.evaluation.body_picture import draw_body
from mixpinn.fem import Material
from mixpinn.fem.scene_record import BUILT_IN
from mixpinn.physics.restraints import Restraints
from mixpinn.records import Evaluation, SampleTable, TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.reduced.newton_steps import NewtonSteps
from mixpinn.serving import AnyPredictor, HybridPredictor, Predictor, load_predictor
from mixpinn.stages.prior import cached_prior
from mixpinn.stages.restraints import describe
from mixpinn.stages.samples import choose_samples
from mixpinn.training.history import HISTORY_FILE, check_history

BODY_PICTURE = "body.png"
REPORT, WEIGHTS = "report.html", ("weights.safetensors", "hybrid.safetensors")

TITLES = {"mixpinn": "MIXPINN", "simple-gat": "Simple GAT", "physgnn": "PhysGNN"}
"""How the models of the paper are called in tables and pictures."""


@dataclass(frozen=True)
class EvaluationConfig:
    """What is evaluated and shown.

    Attributes:
        prior: include the elastic prior, the baseline that needs no training.
        newton_steps: Newton steps of the true solver from the prior, a second such baseline; 0 leaves it out.
        pictures: render the deformed mesh.
        with_paper: show the paper's rows beside the measured ones.
        seed: of the bootstrap.
    """

    prior: bool = True
    newton_steps: int = 1
    pictures: bool = True
    with_paper: bool = False
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Background:
    """What the report tells besides the metrics; every entry may be empty.

    Attributes:
        title: of the page.
        introduction: what was done, in plain words.
        setup: further tables: mesh quality, fidelity, findings.
        stage_seconds: wall time of each stage [s].
        summary: of the simulations.
        provenance: hashes and seeds by group.
    """

    title: str = "Deformation of soft tissue with rigid bodies inside"
    introduction: str = ""
    setup: tuple[Table, ...] = ()
    stage_seconds: Mapping[str, float] | None = None
    summary: GenerationSummary | None = None
    provenance: Mapping[str, Mapping[str, str]] | None = None


@run_scope()
def evaluate_models(
    store: SimulationStore, table: SampleTable, split: Split, models: Sequence[Path | str], config: EvaluationConfig, *,
    out: Path | str, background: Background | None = None, materials: Sequence[Material] | None = None,
    threads: int | None = None, held_out: str | None = None,
) -> tuple[tuple[Evaluation, ...], Path]:
    """Evaluate trained models and the untrained baselines on the test positions; write the report.

    Args:
        store: the simulations.
        table: its samples.
        split: of its positions.
        models: model folders.
        config: what is evaluated and shown.
        out: run directory: one JSON a model, ``report.html``, ``results.json``, ``.csv`` and ``.md``, pictures; a
            finished evaluation there is read again.
        background: what the report tells besides.
        materials: one for each tissue, where the store cannot tell them: a class of one's own.
        threads: CPU threads of the models; None leaves them as they are.
        held_out: a hold-out by name, whose test samples are taken instead of all at the test positions.

    Returns:
        The evaluations, and the path of the report.

    Raises:
        InputError: a model of another mesh or a damaged one; with `config.prior`, materials or joints that are not
            recorded.
    """
    out, background = Path(out), background or Background()
    mesh, test = store.mesh(), held_out_samples(table, choose_samples(table, split, held_out))
    if config.prior:
        materials, restraints = store.materials() if materials is None else tuple(materials), store.restraints()
    trained = [_load(folder, mesh, threads) for folder in models]
    for predictor in trained:
        _require_same_body(predictor, store)
    begun = start_run(
        out, "evaluate", config, seed=config.seed,
        inputs={
            f"model {i} {Path(folder).name} {file}": Path(folder) / file
            for i, folder in enumerate(models) for file in WEIGHTS
        },
        input_hashes={"mesh": mesh.hash(), "store": store.identity, "test samples": _identity(test)},
    )
    if begun and is_finished(out) and (out / REPORT).is_file():
        evaluations = [Evaluation.load(path) for path in sorted(out.glob("evaluation-*.json"))]
        return tuple(evaluations), out / REPORT
    candidates: list[Candidate] = [ZeroModel(mesh.n_points)]
    if materials is not None and config.prior:
        prior = cached_prior(mesh, materials, touched=table.contact_nodes, restraints=restraints)
        candidates.append(prior)
        if config.newton_steps:
            candidates.append(NewtonSteps(prior, materials, steps=config.newton_steps))
    candidates += trained
    evaluations = []
    for index, model in enumerate(candidates):
        with _threads(threads):
            evaluations.append(evaluate(model, test, mesh, split=held_out or "test", notes={"split": split.name}))
        evaluations[-1].save(out / f"evaluation-{index:02d}-{_slug(model.name)}.json")
    pictures: tuple[Picture, ...] = ()
    note = ""
    if config.pictures:
        shown = _shown(candidates, evaluations)
        index = typical_sample(evaluations[shown])
        case = Case.of(
            mesh, test, index, candidates[shown].predict(*test.contact(index)), model=candidates[shown].name,
            probe=store.probe(),
        )
        pictures, note = render_pictures(case, out)
        with contextlib.suppress(InputError):  # joints of one's own law are not read back
            draw_body(mesh, store.restraints(), out / BODY_PICTURE)
            pictures = (*pictures, Picture(out / BODY_PICTURE, "Tissues, bones, joints and supports of this body."))
    histories = {candidates[-len(models) + i].name: Path(folder) / HISTORY_FILE for i, folder in enumerate(models)}
    histories = {name: path for name, path in histories.items() if path.exists()}
    for path in histories.values():
        check_history(path.parent)
    report = write_report(out, ReportContent(
        title=background.title, evaluations=tuple(evaluations), introduction=background.introduction,
        discretisation=store.discretisation,
        mesh=mesh_table(mesh, with_paper=config.with_paper),
        dataset=dataset_counts_table(dataset_table(table, split), with_paper=config.with_paper),
        setup=(*background.setup, *_doubts(mesh)), protocol=_protocol(store, mesh.tissue_names), pictures=pictures,
        picture_note=note,
        loss_logs=histories,
        stage_seconds=background.stage_seconds or {}, fem_seconds=_seconds_a_step(background.summary),
        provenance={
            "Versions": versions(), "Identity": {"mesh": mesh.hash(), "simulations": store.identity},
            **(background.provenance or {}),
        },
        budget=next((model.budget for model in trained if isinstance(model, HybridPredictor)), None),
        with_paper=config.with_paper, seed=config.seed,
    ))
    finish_run(out, {evaluation.model: float(evaluation.metrics["mee"].mean()) for evaluation in evaluations})
    return tuple(evaluations), report


def _doubts(mesh: TissueMesh) -> tuple[Table, ...]:
    """What was noticed about anatomy and mesh, where there is anything."""
    if not mesh.doubts:
        return ()
    rows = tuple((doubt,) for doubt in mesh.doubts)
    return (Table("Doubts about anatomy, mesh and probe", ("What was noticed",), rows),)


def _identity(table: SampleTable) -> str:
    """Which samples are evaluated; what the fields are is told by the identity of the store."""
    return hash_arrays(
        table.position_index, table.rotation_deg, table.depth, table.contact_offsets, table.contact_nodes,
        *(() if table.contact_error is None else (table.contact_error,)),
    )


@contextlib.contextmanager
def _threads(count: int | None) -> Iterator[None]:
    """Have every model timed on the same number of threads, whatever this process did before."""
    before = torch.get_num_threads()
    torch.set_num_threads(count or before)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _load(folder: Path | str, mesh: TissueMesh, threads: int | None) -> AnyPredictor:
    predictor = load_predictor(folder, threads=threads)
    predictor.name = TITLES.get(predictor.name, predictor.name)
    if predictor.mesh_hash != mesh.hash():
        raise InputError(
            str(folder), expected=f"a model of {discretisation_of(mesh)}",
            got=f"one of {discretisation_of(predictor.mesh)}",
            fix="train on this store, or evaluate on the store that the model was trained on",
        )
    return predictor


def _require_same_body(predictor: AnyPredictor, store: SimulationStore) -> None:
    """Refuse a hybrid model of a body with other joints or foundations than those that were simulated."""
    if not isinstance(predictor, HybridPredictor):
        return
    found = predictor.model.prior.restraints.record()
    if found != Restraints.of_record(store.scene, str(store.folder)).record():
        raise InputError(
            predictor.name, expected="a model of a body with the joints and foundations of the simulations",
            got="one with others", fix="fit it on this store, or evaluate on the store that it was fitted on",
        )


def _shown(candidates: Sequence[Candidate], evaluations: Sequence[Evaluation]) -> int:
    """Index of the trained model with the lowest error; of the last candidate where none was trained."""
    trained = [i for i, model in enumerate(candidates) if isinstance(model, (Predictor, HybridPredictor))]
    return min(trained, key=lambda i: float(evaluations[i].metrics["mee"].mean()), default=len(candidates) - 1)


def _seconds_a_step(summary: GenerationSummary | None) -> float | None:
    return summary.solve_seconds / summary.steps if summary is not None and summary.steps else None


def _protocol(store: SimulationStore, tissues: Sequence[str]) -> dict[str, str]:
    protocol, told = store.protocol, {}
    with contextlib.suppress(InputError):  # of recordings and materials of one's own not all is known
        told = {
            f"Tissue: {name}": constants(m) for name, m in zip(tissues, store.materials(), strict=True)
            if len(mixed_parts(name)) == 1
        }
        if len(told) < len(tissues):
            told["Tissue: two in a cell"] = "Lamé constants averaged by volume"
    with contextlib.suppress(InputError):
        told |= describe(store.mesh(), store.restraints())
    with contextlib.suppress(InputError):
        contact = store.contact()
        told["Contact"] = f"Coulomb friction {contact.friction}, gap {contact.gap} mm"
    return {
        **told,
        "Probe positions": f"{len(store.positions)}, every {protocol.spacing:g} mm",
        "Rotations": ", ".join(f"{angle:g}°" for angle in protocol.rotations),
        "Path": f"{protocol.steps} steps of {protocol.step:g} mm along {protocol.direction}",
        "Residual tolerance": _tolerance(store),
        "Contact nodes": "mesh nodes that carry contact force",
    }


def _tolerance(store: SimulationStore) -> str:
    tolerance = store.scene.get("solver", {}).get("tolerance")
    return "unknown" if tolerance is None else f"{tolerance:g} of the contact force"


def constants(material: Material) -> str:
    """A built-in material in words: its Lamé constants, and Young's modulus and Poisson's ratio at rest.

    E = μ (3 λ + 2 μ) / (λ + μ), ν = λ / (2 (λ + μ)).
    """
    if type(material).__name__ not in BUILT_IN:
        return type(material).__name__
    mu, lam = 1e3 * float(getattr(material, "mu")), 1e3 * float(getattr(material, "lam"))  # noqa: B009
    young, poisson = mu * (3.0 * lam + 2.0 * mu) / (lam + mu), 0.5 * lam / (lam + mu)
    law = type(material).__name__
    return f"{law}, μ = {mu:.7g} kPa, λ = {lam:.8g} kPa (E = {young:.3g} kPa, ν = {poisson:.3g} at rest)"


def _slug(name: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in name.lower()).split())
