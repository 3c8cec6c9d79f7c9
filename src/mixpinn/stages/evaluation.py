"""The evaluation stage: a store and trained models in, metrics, pictures and the report out."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.cache import cache_folder
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.base.progress import console
from mixpinn.base.rundir import finish_run, is_finished, start_run, versions
from mixpinn.dataset import GenerationSummary, SimulationStore, Split, dataset_table, held_out_samples
from mixpinn.evaluation import (
    Case,
    DisplacementModel,
    Picture,
    ReportContent,
    Table,
    ZeroModel,
    dataset_counts_table,
    evaluate,
    mesh_table,
    render_pictures,
    results_table,
    typical_sample,
    write_report,
)
from mixpinn.records import Evaluation, Probe, SampleTable, TissueMesh
from mixpinn.reduced.newton_steps import NewtonSteps
from mixpinn.reduced.prior import ElasticPrior, probed_nodes
from mixpinn.serving import AnyPredictor, HybridPredictor, Predictor, load_predictor
from mixpinn.stages.simulation import SimulationConfig, TissueConfig, mesh_materials
from mixpinn.stages.training import choose_samples

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
        simulation: how they were made.
        provenance: hashes and seeds by group.
    """

    title: str = "Deformation of soft tissue with rigid bodies inside"
    introduction: str = ""
    setup: tuple[Table, ...] = ()
    stage_seconds: Mapping[str, float] | None = None
    summary: GenerationSummary | None = None
    simulation: SimulationConfig | None = None
    provenance: Mapping[str, Mapping[str, str]] | None = None


def build_prior(mesh: TissueMesh, tissues: Mapping[str, TissueConfig], default: TissueConfig, table: SampleTable) -> (
    ElasticPrior
):
    """The elastic prior for every node that a probe may touch or a sample touches; kept in the cache."""
    used = [tissues.get(name, default) for name in mesh.tissue_names]
    nodes = np.union1d(probed_nodes(mesh), table.contact_nodes)
    key = hash_arrays(nodes, np.frombuffer(repr((mesh.hash(), used)).encode(), dtype=np.uint8))
    folder = cache_folder("prior", key)
    if (folder / "prior.json").exists():
        with contextlib.suppress(InputError):  # what is damaged in the cache is made anew
            return ElasticPrior.load(folder, mesh)
    prior = ElasticPrior.build(mesh, [tissue.material() for tissue in used], nodes=nodes)
    prior.save(folder)
    return prior


def evaluate_models(
    models: Sequence[Path | str], store: SimulationStore, table: SampleTable, split: Split, config: EvaluationConfig, *,
    out: Path | str, background: Background | None = None, threads: int | None = None, held_out: str | None = None,
) -> tuple[tuple[Evaluation, ...], Path]:
    """Evaluate trained models and the untrained baselines on the test positions; write the report.

    Args:
        models: model folders.
        store: the simulations.
        table: its samples.
        split: of its positions.
        config: what is evaluated and shown.
        out: run directory: one JSON a model, ``report.html``, ``results.json``, ``.csv`` and ``.md``, pictures; a
            finished evaluation there is read again.
        background: what the report tells besides.
        threads: CPU threads of the models.
        held_out: a hold-out by name, whose test samples are taken instead of all at the test positions.

    Returns:
        The evaluations, and the path of the report.

    Raises:
        InputError: a model of another mesh or a damaged one.
    """
    out, background = Path(out), background or Background()
    mesh, test = store.mesh(), held_out_samples(table, choose_samples(table, split, held_out))
    trained = [_load(folder, mesh, threads) for folder in models]
    begun = start_run(
        out, "evaluate", config, seed=config.seed,
        inputs={
            f"model {i} {Path(folder).name} {file}": Path(folder) / file
            for i, folder in enumerate(models) for file in WEIGHTS
        },
        input_hashes={"mesh": mesh.hash(), "store": store.scene_hash, "test samples": _identity(test)},
    )
    if begun and is_finished(out) and (out / REPORT).is_file():
        evaluations = [Evaluation.load(path) for path in sorted(out.glob("evaluation-*.json"))]
        console.print(results_table(evaluations, with_paper=config.with_paper).rich())
        return tuple(evaluations), out / REPORT
    candidates: list[DisplacementModel] = [ZeroModel()]
    simulation = background.simulation or SimulationConfig()
    if config.prior:
        prior = build_prior(mesh, simulation.tissues, simulation.tissue, table)
        candidates.append(prior)
        if config.newton_steps:
            materials = mesh_materials(mesh, simulation.tissues, simulation.tissue)
            candidates.append(NewtonSteps(prior, materials, steps=config.newton_steps))
    candidates += trained
    evaluations = []
    for index, model in enumerate(candidates):
        evaluations.append(evaluate(model, test, mesh, split=held_out or "test", notes={"split": split.name}))
        evaluations[-1].save(out / f"evaluation-{index:02d}-{_slug(model.name)}.json")
    pictures: tuple[Picture, ...] = ()
    note = ""
    if config.pictures:
        shown = _shown(candidates, evaluations)
        index = typical_sample(evaluations[shown])
        probe_file = store.folder / "probe.stl"
        case = Case.of(
            mesh, test, index, candidates[shown].predict(test.contact_field(index)), model=candidates[shown].name,
            probe=Probe.load(probe_file) if probe_file.exists() else None,
        )
        pictures, note = render_pictures(case, out)
    histories = {Path(folder) / "history.csv": candidates[-len(models) + i].name for i, folder in enumerate(models)}
    report = write_report(out, ReportContent(
        title=background.title, evaluations=tuple(evaluations), introduction=background.introduction,
        mesh=mesh_table(mesh, with_paper=config.with_paper),
        dataset=dataset_counts_table(dataset_table(table, split), with_paper=config.with_paper),
        setup=background.setup, protocol=_protocol(store, simulation), pictures=pictures, picture_note=note,
        loss_logs={name: path for path, name in histories.items() if path.exists()},
        stage_seconds=background.stage_seconds or {}, fem_seconds=_seconds_a_step(background.summary),
        provenance={
            "Versions": versions(), "Identity": {"mesh": mesh.hash(), "simulations": store.scene_hash},
            **(background.provenance or {}),
        },
        with_paper=config.with_paper, seed=config.seed,
    ))
    console.print(results_table(evaluations, with_paper=config.with_paper).rich())
    finish_run(out, {evaluation.model: float(evaluation.metrics["mee"].mean()) for evaluation in evaluations})
    return tuple(evaluations), report


def _identity(table: SampleTable) -> str:
    """Which samples are evaluated; what the fields are is told by the identity of the store."""
    return hash_arrays(
        table.position_index, table.rotation_deg, table.depth, table.contact_offsets, table.contact_nodes,
        *(() if table.contact_error is None else (table.contact_error,)),
    )


def _load(folder: Path | str, mesh: TissueMesh, threads: int | None) -> AnyPredictor:
    predictor = load_predictor(folder, threads=threads)
    predictor.name = TITLES.get(predictor.name, predictor.name)
    if predictor.mesh_hash != mesh.hash():
        raise InputError(
            str(folder), expected=f"a model of mesh {mesh.hash()}", got=f"one of mesh {predictor.mesh_hash}",
            fix="train on this store, or evaluate on the store that the model was trained on",
        )
    return predictor


def _shown(candidates: Sequence[DisplacementModel], evaluations: Sequence[Evaluation]) -> int:
    """Index of the trained model with the lowest error; of the last candidate where none was trained."""
    trained = [i for i, model in enumerate(candidates) if isinstance(model, (Predictor, HybridPredictor))]
    return min(trained, key=lambda i: float(evaluations[i].metrics["mee"].mean()), default=len(candidates) - 1)


def _seconds_a_step(summary: GenerationSummary | None) -> float | None:
    return summary.solve_seconds / summary.steps if summary is not None and summary.steps else None


def _protocol(store: SimulationStore, simulation: SimulationConfig) -> dict[str, str]:
    protocol, tissue = store.protocol, simulation.tissue
    constants = (
        f"μ = {tissue.mu} kPa, λ = {tissue.lam} kPa" if tissue.mu is not None
        else f"E = {tissue.young} kPa, ν = {tissue.poisson}"
    )
    return {
        "Tissue": f"{tissue.energy} ({constants})",
        "Contact": f"Coulomb friction {simulation.contact.friction}, gap {simulation.contact.gap} mm",
        "Probe positions": f"{len(store.positions)}, every {protocol.spacing:g} mm",
        "Rotations": ", ".join(f"{angle:g}°" for angle in protocol.rotations),
        "Path": f"{protocol.steps} steps of {protocol.step:g} mm along {protocol.direction}",
        "Residual tolerance": f"{simulation.solver.tolerance:g} of the contact force",
        "Contact nodes": "mesh nodes that carry contact force",
    }


def _slug(name: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in name.lower()).split())
