"""Evaluate a model: predict every sample of a table and keep its metrics and its wall time."""

import time
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch

from mixpinn.base.arrays import AnyArray, Float32Array
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.evaluation.metrics import (
    AS_PUBLISHED,
    MetricGeometry,
    VirtualTopology,
    errors_by_part,
    sample_metrics,
    virtual_reference,
)
from mixpinn.records import Evaluation, SampleTable, TissueMesh
from mixpinn.records.answer import discretisation_of


@runtime_checkable
class Candidate(Protocol):
    """What is evaluated: anything that turns contact displacements into a displacement field."""

    @property
    def name(self) -> str:
        """Name for tables and plots."""

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> AnyArray:
        """Displacement of every mesh node [mm], shape (n, 3).

        Args:
            nodes: contact nodes, each once, shape (c,).
            displacements: of each [mm], float32, shape (c, 3).

        Nodes of ten-node cells are vertices, which come first, and midpoints, which the answer may leave out.
        """


@runtime_checkable
class VirtualCandidate(Candidate, Protocol):
    """A model with virtual nodes or virtual edges, evaluated ``as published`` too."""

    @property
    def virtual(self) -> VirtualTopology | None:
        """The virtual nodes and edges that the model adds; None where it has none."""

    def predict_with_virtual(self, nodes: AnyArray, displacements: AnyArray) -> AnyArray:
        """Displacement of mesh and virtual nodes [mm], shape (n + v, 3); operands as in `predict`."""


class ZeroModel:
    """Predicts that nothing moves: its MEE is the mean displacement, the scale of every other error."""

    name = "No motion"

    def __init__(self, n_nodes: int) -> None:
        self.n_nodes = n_nodes

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Zero displacement of every node [mm], shape (n, 3)."""
        return np.zeros((self.n_nodes, 3), dtype=np.float32)


def evaluate(
    model: Candidate, table: SampleTable, mesh: TissueMesh, *, split: str,
    notes: Mapping[str, Any] | None = None, warm_up: int = 2,
) -> Evaluation:
    """Predict every sample of `table` and measure the errors at the vertices of the mesh.

    Latency is the wall time of `predict` for one sample, from contact nodes to output array, after `warm_up`
    predictions that are not counted. Models with virtual nodes or edges (`VirtualCandidate`) are asked a second time,
    untimed, for the metrics ``as published``, which count those too.

    Args:
        model: what is evaluated.
        table: the samples; their contact nodes are the model's input.
        mesh: the mesh of the samples.
        split: name of the split, for tables.
        notes: what a reader must know besides, kept in the record.
        warm_up: predictions before the clock counts.

    Raises:
        InputError: no samples, samples of another mesh, or predictions of a wrong shape or not finite.

    Example:
        >>> metrics = evaluate(ZeroModel(mesh.n_points), table, mesh, split="test").metrics
        >>> bool(np.allclose(metrics["mee"], metrics["mean_displacement"]))
        True
    """
    if not len(table):
        raise InputError(f"split {split}", expected="at least one sample", got="none", fix="simulate more positions")
    if table.mesh_hash != mesh.hash():
        raise InputError(
            f"samples of split {split}", expected=f"samples of {discretisation_of(mesh)}",
            got=f"those of {table.made_on}",
            fix="evaluate on the mesh that was simulated",
        )
    geometry = MetricGeometry.of(mesh)
    virtual = model.virtual if isinstance(model, VirtualCandidate) else None
    for _ in range(warm_up):
        model.predict(*table.contact(0))
    metrics: dict[str, list[float]] = {}
    parts: dict[str, list[float]] = {}
    seconds = np.empty(len(table))
    for index in track(range(len(table)), f"{model.name} on {split}"):
        contact, reference = table.contact(index), table.displacement[index, : mesh.n_points]
        start = time.perf_counter()
        answer = model.predict(*contact)
        seconds[index] = time.perf_counter() - start
        predicted = answer[: mesh.n_points]
        values = sample_metrics(predicted, reference, geometry)
        values["largest_error"] = float(np.sqrt(np.square(predicted - reference).sum(axis=1).max()))
        if virtual is not None and isinstance(model, VirtualCandidate):
            values |= _as_published(model.predict_with_virtual(*contact), reference, geometry, virtual)
        values["mean_displacement"] = float(np.linalg.norm(reference, axis=1).mean())
        for name, value in values.items():
            metrics.setdefault(name, []).append(value)
        for name, value in errors_by_part(predicted, reference, geometry).items():
            parts.setdefault(name, []).append(value)
    return Evaluation(
        model=model.name, split=split, metrics={name: np.array(value) for name, value in metrics.items()},
        about={
            "position": table.position_index.astype(np.float64), "rotation": table.rotation_deg.astype(np.float64),
            "depth": table.depth.astype(np.float64),
        },
        by_part={name: np.array(value) for name, value in parts.items()}, seconds=seconds,
        notes={
            "mesh": table.mesh_hash, "discretisation": discretisation_of(mesh), "threads": torch.get_num_threads(),
            **(notes or {}),
        },
    )


def _as_published(
    predicted: AnyArray, reference: AnyArray, geometry: MetricGeometry, virtual: VirtualTopology,
) -> dict[str, float]:
    """The metrics over mesh and virtual nodes and edges, names with the suffix `AS_PUBLISHED`."""
    target = virtual_reference(reference, geometry, virtual)
    values = sample_metrics(predicted, target, geometry.with_virtual(virtual))
    return {name + AS_PUBLISHED: value for name, value in values.items()}
