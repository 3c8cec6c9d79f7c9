"""Predictor: load a trained model once, predict many times."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from mixpinn.base.arrays import AnyArray, Float32Array
from mixpinn.base.errors import InputError
from mixpinn.graph import MeshGraph
from mixpinn.networks import DisplacementModel, ModelConfig, load_checkpoint, load_network_mesh, model_name
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Answer, Contact, Source, discretisation_of
from mixpinn.serving.contact_input import checked_contact, spread
from mixpinn.serving.motions import motions_of_field

if TYPE_CHECKING:
    from mixpinn.evaluation import VirtualTopology


class Predictor:
    """A trained network on its mesh; n mesh nodes, N nodes with the virtual ones.

    Attributes:
        name: of the model, for tables.
        config: of the network.
        mesh: the mesh that it was trained on.
        graph: what the network reads.
        threads: CPU threads of the process from a prediction on; None leaves them as they are.
        loading_seconds: how long loading and warming up took [s].

    Example:
        >>> predictor = Predictor.load("runs/model")
        >>> nodes = np.flatnonzero((predictor.mesh.part == 0) & ~predictor.mesh.fixed)[:2]
        >>> predictor.predict_at(nodes, [[0.0, -3.0, 0.0], [0.0, -2.8, 0.1]]).save("deformed.vtu")
    """

    def __init__(
        self, model: DisplacementModel, graph: MeshGraph, config: ModelConfig, mesh: TissueMesh, *, name: str,
        threads: int | None = None,
    ) -> None:
        self.name, self.config, self.mesh, self.graph, self.threads = name, config, mesh, graph, threads
        self.loading_seconds = 0.0
        self._model = model.eval()

    @staticmethod
    def load(
        folder: Path | str, *, mesh: TissueMesh | None = None, threads: int | None = None, name: str | None = None,
        warm_up: bool = True,
    ) -> "Predictor":
        """Read a model folder.

        Args:
            folder: what training wrote.
            mesh: the mesh that it is to be used on; None takes the folder's own.
            threads: CPU threads of a prediction; None leaves them as they are.
            name: for tables; None takes the name of the model's configuration, else the folder's.
            warm_up: make one prediction, so that the next one is not slowed down by compilation.

        Raises:
            InputError: the folder is incomplete, damaged, or of another topology.
        """
        began = time.perf_counter()
        if threads is not None and threads < 1:
            raise InputError("threads", expected="at least 1", got=str(threads), fix="give a positive number")
        if mesh is None:
            mesh = load_network_mesh(folder)
        model, graph, config = load_checkpoint(folder, mesh=mesh)
        name = name or model_name(config) or Path(folder).resolve().name
        predictor = Predictor(model, graph, config, mesh, name=name, threads=threads)
        if warm_up:
            predictor.predict(np.zeros(1, dtype=np.int64), np.zeros((1, 3)))
        predictor.loading_seconds = time.perf_counter() - began
        return predictor

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of every mesh node [mm], float32, shape (n, 3).

        Args:
            nodes: ids of the contact nodes, each once, shape (c,).
            displacements: displacement of each of them [mm], shape (c, 3).

        Raises:
            InputError: unknown or repeated nodes, another shape, or values that are not finite.
        """
        return self.predict_with_virtual(nodes, displacements)[: self.graph.n_mesh_nodes]

    def predict_with_virtual(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of mesh and virtual nodes [mm], float32, shape (N, 3); operands and errors as in `predict`."""
        n_nodes = self.mesh.n_nodes
        field = spread(*checked_contact(nodes, displacements, n_nodes=n_nodes), n_nodes=n_nodes)
        field = field[: self.graph.n_mesh_nodes]  # a network reads the vertices
        if self.threads is not None and torch.get_num_threads() != self.threads:
            torch.set_num_threads(self.threads)
        with torch.inference_mode():
            return self._model(torch.from_numpy(field)[None])[0].numpy()

    def predict_at(self, nodes: AnyArray, displacements: AnyArray, *, reference: AnyArray | None = None) -> Answer:
        """The whole answer to contact displacements; a network knows neither forces nor its own error.

        Args:
            nodes: ids of the contact nodes, each once, shape (c,).
            displacements: displacement of each of them [mm], shape (c, 3).
            reference: what is to be predicted, if known [mm], shape (n, 3).

        Raises:
            InputError: unknown or repeated nodes, another shape, or values that are not finite.
        """
        held, moved = checked_contact(nodes, displacements, n_nodes=self.mesh.n_nodes)
        field = self.predict(held, moved)
        return Answer(
            self.mesh, field, Source.NETWORK, model=self.name, motions=motions_of_field(self.mesh, field),
            contact=Contact(held, moved), discretisation=discretisation_of(self.mesh), reference=reference,
        )

    def press(self, tip: AnyArray | Sequence[float], *, rotation_deg: float = 0.0) -> Answer:
        """A network takes contact displacements, not the probe's pose.

        Raises:
            InputError: always.
        """
        raise InputError(
            self.name, expected="a hybrid model, which takes the probe's pose", got="a network",
            fix="give contact displacements, or train with --model hybrid",
        )

    @property
    def mesh_hash(self) -> str:
        """Identity of the mesh."""
        return self.graph.mesh_hash

    @property
    def virtual(self) -> "VirtualTopology | None":
        """The virtual nodes and edges of the model's graph, for the metrics ``as published``; None without any."""
        graph = self.graph
        if graph.n_edges == graph.n_mesh_edges:
            return None
        # Imported here: predicting needs no metrics.
        from mixpinn.evaluation import VirtualTopology

        added = graph.edge_index[:, graph.n_mesh_edges:]
        once = added[:, added[0] < added[1]]
        return VirtualTopology(
            points=graph.position[graph.n_mesh_nodes:].numpy(), part=graph.virtual_node_part.numpy(),
            edges=once.T.numpy(),
        )
