"""The mesh as a graph: features, virtual nodes and edges, and what a network reads and answers on it."""

from mixpinn.graph.assembly import node_input, virtual_targets
from mixpinn.graph.diameter import part_diameters, rigid_reach
from mixpinn.graph.features import edge_features, node_features
from mixpinn.graph.mesh_graph import MeshGraph, build_graph
from mixpinn.graph.scaling import Scaling, ScalingStatistics, identity_statistics, standard_statistics
from mixpinn.graph.virtual_edges import VirtualEdges
from mixpinn.graph.virtual_nodes import VirtualNodes

__all__ = [
    "MeshGraph", "Scaling", "ScalingStatistics", "VirtualEdges", "VirtualNodes", "build_graph", "edge_features",
    "identity_statistics", "node_features", "node_input", "part_diameters", "rigid_reach",
    "standard_statistics", "virtual_targets",
]
