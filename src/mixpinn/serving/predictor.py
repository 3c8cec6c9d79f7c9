"""Predictor: load a trained model once, predict many times."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from mixpinn.base.arrays import AnyArray, Float32Array
from mixpinn.base.errors import InputError
from mixpinn.graph import MeshGraph
from mixpinn.networks import DisplacementModel, ModelConfig, load_checkpoint, load_network_mesh, model_name
from mixpinn.records import Prediction, TissueMesh
from mixpinn.serving.contact_input import checked_field, contact_field

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
    ) -> "Predictor":
        """Read a model folder and make one prediction, so that the next one is not slowed down by compilation.

        Args:
            folder: what training wrote.
            mesh: the mesh that it is to be used on; None takes the folder's own.
            threads: CPU threads of a prediction; None leaves them as they are.
            name: for tables; None takes the name of the model's configuration, else the folder's.

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
        predictor.predict(np.zeros((mesh.n_points, 3), dtype=np.float32))
        predictor.loading_seconds = time.perf_counter() - began
        return predictor

    def predict(self, contact_displacement: AnyArray) -> Float32Array:
        """Displacement of every mesh node [mm], float32, shape (n, 3).

        Args:
            contact_displacement: of the contact nodes, zero elsewhere [mm], shape (n, 3).

        Raises:
            InputError: another shape, or values that are not finite.
        """
        return self.predict_with_virtual(contact_displacement)[: self.graph.n_mesh_nodes]

    def predict_with_virtual(self, contact_displacement: AnyArray) -> Float32Array:
        """Displacement of mesh and virtual nodes [mm], float32, shape (N, 3); operand and errors as in `predict`."""
        field = checked_field(contact_displacement, n_nodes=self.graph.n_mesh_nodes)
        if self.threads is not None and torch.get_num_threads() != self.threads:
            torch.set_num_threads(self.threads)
        with torch.inference_mode():
            return self._model(torch.from_numpy(field)[None])[0].numpy()

    def predict_at(
        self, nodes: AnyArray, displacements: AnyArray, *, reference: AnyArray | None = None,
    ) -> Prediction:
        """Predict from a list of contact nodes.

        Args:
            nodes: ids of the contact nodes, each once, shape (c,).
            displacements: displacement of each of them [mm], shape (c, 3).
            reference: what is to be predicted, if known [mm], shape (n, 3).

        Raises:
            InputError: unknown or repeated nodes, another shape, or values that are not finite.
        """
        field = contact_field(nodes, displacements, n_nodes=self.graph.n_mesh_nodes)
        return Prediction(self.mesh, self.predict(field), reference, self.name)

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
