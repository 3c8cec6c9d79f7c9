"""MeshGraph: one topology that all samples of a mesh share."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from mixpinn.base.errors import InputError
from mixpinn.graph.features import edge_features, edge_part, node_features
from mixpinn.records import TissueMesh


@dataclass(frozen=True, eq=False)
class MeshGraph:
    """Nodes and directed edges of a mesh, in both directions; N nodes, E edges, K rigid parts, V virtual nodes.

    The first `n_mesh_nodes` nodes are the mesh's, in its order, and the first `n_mesh_edges` edges are the mesh's;
    virtual ones follow.

    Attributes:
        position: rest positions [mm], float64, shape (N, 3).
        part: 0 for soft tissue or k = 1 … K, int64, shape (N,).
        node_features: x, y, z, r [mm], θ, φ [rad], one-hot part, float32, shape (N, 6 + K).
        edge_index: source and target of each directed edge, int64, shape (2, E).
        edge_features: length [mm], one-hot part by the both-ends rule, float32, shape (E, 1 + K).
        n_mesh_nodes: number n of nodes that are the mesh's.
        n_mesh_edges: number of directed edges that are the mesh's.
        virtual_node_part: part of each virtual node, int64, shape (V,).
        rigid_names: names of the parts 1 … K.
        mesh_hash: `TissueMesh.hash` of the mesh.
    """

    position: Tensor
    part: Tensor
    node_features: Tensor
    edge_index: Tensor
    edge_features: Tensor
    n_mesh_nodes: int
    n_mesh_edges: int
    virtual_node_part: Tensor
    rigid_names: tuple[str, ...]
    mesh_hash: str

    @property
    def n_nodes(self) -> int:
        """Number of nodes N, virtual ones included."""
        return len(self.position)

    @property
    def n_edges(self) -> int:
        """Number of directed edges E, virtual ones included."""
        return self.edge_index.shape[1]

    @property
    def n_parts(self) -> int:
        """Number of rigid parts K."""
        return len(self.rigid_names)

    @property
    def n_inputs(self) -> int:
        """Number of node features that a network reads, contact displacement included: 9 + K."""
        return 3 + self.node_features.shape[1]

    @cached_property
    def edge_part(self) -> Tensor:
        """Part of each directed edge by the both-ends rule, shape (E,)."""
        return edge_part(self.part, self.edge_index)

    @property
    def edge_length(self) -> Tensor:
        """Rest length of each directed edge [mm], float32, shape (E,)."""
        return self.edge_features[:, 0]

    @cached_property
    def rigid_edges(self) -> Tensor:
        """Directed edges inside rigid parts, virtual ones included: what the Rigid Edge Loss covers; shape (2, R)."""
        return self.edge_index[:, self.edge_part > 0]

    @cached_property
    def mesh_rigid_edges(self) -> Tensor:
        """Directed mesh edges inside rigid parts: what the Rigid Edge Error counts; shape (2, R)."""
        kept = self.edge_part > 0
        kept[self.n_mesh_edges:] = False
        return self.edge_index[:, kept]

    def rest_length(self, edges: Tensor) -> Tensor:
        """Rest length of each of `edges`, shape (2, R) [mm]: float64, shape (R,)."""
        return torch.linalg.vector_norm(self.position[edges[1]] - self.position[edges[0]], dim=1)

    def part_nodes(self, k: int) -> Tensor:
        """Mesh nodes of rigid part k (1 … K), or of the soft tissue for k = 0."""
        return torch.nonzero(self.part[: self.n_mesh_nodes] == k).flatten()

    def with_edges(self, edge_index: Tensor) -> "MeshGraph":
        """The graph with the directed edges `edge_index`, shape (2, A), appended, features included."""
        added = edge_features(self.position, self.part, edge_index, self.n_parts)
        return replace(
            self, edge_index=torch.cat([self.edge_index, edge_index], dim=1),
            edge_features=torch.cat([self.edge_features, added]),
        )

    def to(self, device: torch.device | str) -> "MeshGraph":
        """The graph on another device."""
        return replace(
            self, position=self.position.to(device), part=self.part.to(device),
            node_features=self.node_features.to(device), edge_index=self.edge_index.to(device),
            edge_features=self.edge_features.to(device), virtual_node_part=self.virtual_node_part.to(device),
        )


def build_graph(mesh: TissueMesh) -> MeshGraph:
    """The graph of a mesh: every edge of its cells in both directions, sorted by target, then source.

    Raises:
        InputError: the mesh has no cells.
    """
    if len(mesh.cells) == 0:
        raise InputError("mesh", expected="at least one cell", got="none", fix="build the mesh again")
    directed = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
    directed = directed[np.lexsort((directed[:, 0], directed[:, 1]))]
    edge_index = torch.from_numpy(np.ascontiguousarray(directed.T))
    position = torch.from_numpy(np.array(mesh.points, dtype=np.float64))
    part = torch.from_numpy(np.array(mesh.part, dtype=np.int64))
    return MeshGraph(
        position=position, part=part, node_features=node_features(position, part, mesh.n_parts),
        edge_index=edge_index, edge_features=edge_features(position, part, edge_index, mesh.n_parts),
        n_mesh_nodes=mesh.n_points, n_mesh_edges=edge_index.shape[1],
        virtual_node_part=torch.zeros(0, dtype=torch.int64), rigid_names=tuple(mesh.rigid_names),
        mesh_hash=mesh.hash(),
    )
