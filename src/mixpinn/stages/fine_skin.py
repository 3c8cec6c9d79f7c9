"""The finer skin of contact from the pose, computed once and kept in the cache."""

import contextlib
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.lock import locked
from mixpinn.base.progress import console
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.fem import ElasticSystem, LocalRefinement, Material, default_solver
from mixpinn.fem.local_refinement import refine_skin
from mixpinn.fem.nested_faces import face_functions, owning_faces
from mixpinn.press.contact import candidate_faces
from mixpinn.press.fine_skin import ALONG, FineSkin, own_along
from mixpinn.records import TissueMesh
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.stages.prior import body_folder

_RATIO = 1.4
"""Longest edge of the finer skin, in those of cells simulated under the probe. As short ones as these, with twice the
nodes, told forces little better in a trial on one patient."""
_NEAR = 20.0
"""Pairs of nodes farther apart than this yield to each other as the own mesh has it [mm]."""
_FILE = "fine_skin.safetensors"


def cached_fine_skin(prior: ElasticPrior, materials: Sequence[Material], refinement: LocalRefinement) -> FineSkin:
    """Finer skin for the candidates of a prior; computed once, then read from the cache.

    Args:
        prior: on a mesh of order 2.
        materials: one for each tissue.
        refinement: of the cells that are simulated under the probe.
    """
    edges = refinement.scaled(_RATIO)
    settings = edges.edge, edges.growth, _NEAR
    folder = body_folder("fine_skin", prior.mesh, materials, prior.restraints, prior.nodes, *settings)
    if folder is None:
        return build_fine_skin(prior, materials, edges)
    with locked(folder, wait=True):
        with contextlib.suppress(InputError):  # what is absent or damaged in the cache is made anew
            arrays = read_arrays(folder / _FILE)[0]
            return FineSkin.of_arrays(arrays, candidates=len(prior.nodes), where=str(folder), remake="")
        found = build_fine_skin(prior, materials, edges)
        write_arrays(folder / _FILE, found.arrays())
        return found


def build_fine_skin(prior: ElasticPrior, materials: Sequence[Material], edges: LocalRefinement) -> FineSkin:
    """Solve the body at rest with finer cells along all of the candidates' skin; arguments of `cached_fine_skin`."""
    own = candidate_faces(prior.mesh, prior.nodes)
    mesh = refine_skin(prior.mesh, own[:, :3], edges)
    corners = np.ascontiguousarray(prior.mesh.points)
    every = np.ascontiguousarray(prior.mesh.skin_faces)
    probed: BoolArray = np.asarray(np.isin(prior.mesh.skin_node_faces, prior.nodes).all(axis=1))
    middles = mesh.points[mesh.skin_faces].mean(axis=1)
    faces = mesh.skin_node_faces[probed[owning_faces(middles, corners, every)]]
    nodes, local = np.unique(faces, return_inverse=True)
    places = np.ascontiguousarray(mesh.node_points[nodes])
    owner = own[owning_faces(places, corners, np.ascontiguousarray(own[:, :3]))]
    tree = cKDTree(places)
    return FineSkin.of_compliance(
        places, local.reshape(faces.shape).astype(np.int64), np.searchsorted(prior.nodes, owner),
        face_functions(places, corners[owner[:, :3]], 2), compliance=_compliance(prior, mesh, materials, nodes),
        own=own_along(prior), near=tree.sparse_distance_matrix(tree, _NEAR, output_type="coo_matrix"),
    )


def _compliance(
    prior: ElasticPrior, mesh: TissueMesh, materials: Sequence[Material], nodes: IntArray,
) -> FloatArray:
    """Of nodes of `mesh` along y at rest [mm/N], shape (n, n)."""
    console.print(f"finer skin for forces: {len(nodes):,} nodes on cells of {mesh.n_nodes:,}", soft_wrap=True)
    restraints = prior.restraints
    system = ElasticSystem(
        mesh, materials, joints=restraints.joints, foundations=restraints.foundations, membrane=restraints.membrane,
    )
    unknowns = system.node_dofs(nodes)[:, ALONG]
    order = np.argsort(unknowns)
    order = order[unknowns[order] >= 0]  # others are held, and do not yield
    found = np.zeros((len(nodes), len(nodes)))
    found[np.ix_(order, order)] = default_solver().factorize_with_compliance(
        system.tangent(system.rest_state(), project=True), unknowns[order],
    )
    return found
