"""AblationJob: one training of the table with its evaluations, in a run directory of its own."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_file
from mixpinn.base.validated import load_record
from mixpinn.dataset import Split
from mixpinn.evaluation import evaluate
from mixpinn.networks import MODELS, WEIGHTS_FILE, ModelConfig
from mixpinn.records import MESH_FILE, Evaluation, SampleTable, TissueMesh
from mixpinn.serving import Predictor
from mixpinn.stages.training import train_network
from mixpinn.studies.ablation_config import AblationConfig
from mixpinn.training import TrainingSettings

SAMPLES, EVALUATIONS, MODELS_FOLDER = "samples", "evaluations", "rows"
SETS = "sets.json"
"""Names of the test sets, beside their samples; written last."""
REMAKE = "begin the table in another folder"


@dataclass(frozen=True)
class AblationJob:
    """One training.

    Attributes:
        name: of its folder.
        row: model of the paper's tables.
        seed: of its training.
        positions: training positions, all where None.
        model: the network.
        train: optimizer, schedule, limits.
    """

    name: str
    row: str
    seed: int
    positions: tuple[int, ...] | None
    model: ModelConfig
    train: TrainingSettings


def model_of(row: str, config: AblationConfig) -> ModelConfig:
    """The network of a row at the depth, width and scaling of the table."""
    listed = MODELS[row]
    hidden = config.physgnn_hidden if listed.architecture == "physgnn" else config.hidden
    return replace(listed, layers=config.layers, hidden=hidden, scaling=config.scaling)


def training_of(row: str, config: AblationConfig, *, seed: int, samples: int) -> TrainingSettings:
    """The training of a row; `samples` is the number of its training samples, which turns passes into epochs."""
    train = replace(config.train, seed=seed)
    if MODELS[row].architecture == "physgnn":
        train = replace(train, learning_rate=config.physgnn_learning_rate, batch_size=config.physgnn_batch_size)
    if config.passes is not None:
        train = replace(train, max_epochs=max(1, round(config.passes / samples)))
    return train.for_model(MODELS[row])


def plan_jobs(config: AblationConfig, split: Split, train: SampleTable) -> tuple[AblationJob, ...]:
    """All trainings of a table: every row with the first seed, then the data need, then the further seeds.

    The positions of the data-need curve are nested: the first of one permutation of the training positions, drawn
    from ``numpy.random.default_rng`` with the split's seed.

    Raises:
        InputError: more positions are asked for than there are.
    """
    def job(row: str, seed: int, positions: tuple[int, ...] | None = None) -> AblationJob:
        several = "" if positions is None else f"-positions-{len(positions)}"
        count = len(train) if positions is None else int(np.isin(train.position_index, positions).sum())
        return AblationJob(
            f"{row}{several}-seed-{seed}", row, seed, positions, model_of(row, config),
            training_of(row, config, seed=seed, samples=max(1, count)),
        )

    first, *further = config.seeds
    # The slowest first, so that the last worker does not end long after the others.
    rows = sorted(config.models, key=lambda row: MODELS[row].architecture != "physgnn")
    order = np.random.default_rng(config.split.seed).permutation(split.train)
    if config.few_positions and max(config.few_positions) > len(order):
        raise InputError(
            "few_positions", expected=f"at most the {len(order)} training positions",
            got=str(max(config.few_positions)), fix="correct the setting",
        )
    few = [tuple(int(position) for position in np.sort(order[:count])) for count in config.few_positions]
    repeated = [row for row in rows if row in config.repeated]
    return (
        *(job(row, first) for row in rows),
        *(job(config.few_row, first, positions) for positions in few),
        *(job(row, seed) for seed in further for row in repeated),
    )


def run_job(job: AblationJob, folder: Path, *, devices: int = 1) -> None:
    """Train, or go on training, and evaluate on every test set; what is finished is kept.

    Args:
        job: what is trained.
        folder: of the table: samples in ``samples/``, the run directory in ``rows/NAME``, metrics in ``evaluations/``.
        devices: processes of the training, each with a device of its own.

    Raises:
        InputError: damaged samples or a damaged run directory.
        SolveError: the training diverged.
    """
    mesh = TissueMesh.load(folder / SAMPLES / MESH_FILE)
    train, validation = (SampleTable.load(folder / SAMPLES / part) for part in ("train", "validation"))
    if job.positions is not None:
        train = train.at_positions(np.array(job.positions))
    out = folder / MODELS_FOLDER / job.name
    train_network(mesh, train, validation, job.model, job.train, out=out, devices=devices)
    predictor = Predictor.load(out, mesh=mesh, threads=job.train.threads, name=job.row)
    weights = hash_file(out / WEIGHTS_FILE)
    for name in test_set_names(folder):
        evaluate_once(
            predictor, folder, name, mesh, path=evaluation_path(folder, job.name, name),
            notes={"weights": weights, "row": job.row, "seed": job.seed},
        )


def test_set_names(folder: Path) -> list[str]:
    """Names of the test sets of a table, in its order."""
    kept = load_record(dict[str, list[dict[str, Any]]], folder / SAMPLES / SETS, remake=REMAKE)
    return [str(entry["name"]) for entry in kept["sets"]]


def evaluation_path(folder: Path, model: str, test_set: str) -> Path:
    """Where the metrics of a model on a test set lie."""
    return folder / EVALUATIONS / model / f"{test_set}.json"


def evaluate_once(
    model: object, folder: Path, test_set: str, mesh: TissueMesh, *, path: Path, notes: dict[str, object],
) -> Evaluation:
    """Evaluate on a test set, or read the evaluation that was made of the same weights and samples."""
    from mixpinn.evaluation import Candidate

    assert isinstance(model, Candidate)
    if path.exists():
        before = Evaluation.load(path)
        if all(before.notes.get(key) == value for key, value in notes.items()):
            return before
    evaluation = evaluate(model, SampleTable.load(folder / SAMPLES / test_set), mesh, split=test_set, notes=notes)
    evaluation.save(path)
    return evaluation
