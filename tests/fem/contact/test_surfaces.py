"""Skin and probe surfaces: who follows whom, and how densely the probe is sampled."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fem.block_mesh import block, two_bones
from mixpinn.base.errors import InputError
from mixpinn.fem import PAPER_TISSUE, ElasticSystem, SkinSurface
from mixpinn.fem.contact.surfaces import SkinPatch
from mixpinn.fem.contact.unknowns import ContactUnknowns
from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.geometry.probe_surface import ProbeSurface

AFFINE = np.array([[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.05, 0.0, 1.0]])


def test_the_meshs_own_skin_is_its_boundary() -> None:
    mesh = block((2, 2, 2))
    skin = SkinSurface.of_mesh(mesh)
    assert len(skin.nodes) == 26
    corners = skin.vertices(mesh.points)[skin.surface.triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert area == pytest.approx(6.0)


def test_an_embedded_surface_follows_every_affine_motion() -> None:
    mesh = block((3, 3, 3), size=(30.0, 30.0, 30.0), shake=0.2)
    points = np.array([[3.0, 30.0, 4.0], [14.0, 29.5, 17.0], [25.0, 30.2, 8.0], mesh.points[-1]])
    skin = SkinSurface.embedded(mesh, points, np.array([[0, 1, 2], [1, 3, 2]]))
    np.testing.assert_allclose(skin.weights.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(skin.vertices(mesh.points @ AFFINE.T + 1.0), points @ AFFINE.T + 1.0, atol=1e-9)


def test_an_embedded_surface_far_from_the_mesh_is_refused() -> None:
    with pytest.raises(InputError, match="far"):
        SkinSurface.embedded(block((2, 2, 2)), np.full((3, 3), 500.0), np.array([[0, 1, 2]]))


def test_probe_samples_leave_no_hole_wider_than_the_spacing() -> None:
    probe = linear_probe()
    surface = ProbeSurface.of_probe(probe, spacing=2.0)
    np.testing.assert_array_equal(surface.samples[: len(probe.points)], probe.points)
    weights = np.random.default_rng(0).dirichlet(np.ones(3), size=(len(probe.triangles), 5))
    anywhere = np.einsum("tsc,tck->tsk", weights, probe.points[probe.triangles]).reshape(-1, 3)
    assert cKDTree(surface.samples).query(anywhere)[0].max() <= 2.0


def test_samples_of_a_sphere_lie_on_its_triangles() -> None:
    surface = ProbeSurface.of_probe(spherical_probe(radius=10.0, subdivisions=1), spacing=1.5)
    radius = np.linalg.norm(surface.samples - [0.0, 10.0, 0.0], axis=1)
    assert radius.max() == pytest.approx(10.0)
    assert radius.min() > 9.0


def test_a_patch_keeps_whole_triangles_only() -> None:
    skin = SkinSurface.of_mesh(block((2, 2, 2)))
    triangle = skin.surface.triangles[5]
    patch = SkinPatch.of_vertices(skin, np.unique(triangle))
    assert len(patch.triangles) == 1
    assert set(patch.vertices[patch.triangles[0]]) == set(triangle)


def test_unknowns_of_a_patch_move_its_vertices_as_the_body_does() -> None:
    mesh = two_bones()
    system = ElasticSystem(mesh, [PAPER_TISSUE])
    # Vertices inside cells that touch a bone hang on its twist, too.
    rng = np.random.default_rng(1)
    beside = mesh.cells[(mesh.part[mesh.cells] == 1).any(axis=1) & (mesh.part[mesh.cells] == 0).any(axis=1)]
    points = np.einsum("vw,vwk->vk", rng.dirichlet(np.ones(4), 6), mesh.points[beside[rng.choice(len(beside), 6)]])
    skin = SkinSurface.embedded(mesh, points, np.array([[0, 1, 2], [3, 4, 5]]))
    unknowns = ContactUnknowns(system, skin, SkinPatch.of_vertices(skin, np.arange(6)))
    state = system.advance(system.rest_state(), rng.normal(scale=0.05, size=system.n_dofs))
    small = 1e-6 * rng.normal(size=system.n_dofs)
    moved = unknowns.positions(system.advance(state, small)) - unknowns.positions(state)
    predicted = unknowns.jacobian(state) @ small[unknowns.kept]
    assert (unknowns.kept >= system.n_dofs - 12).any()
    np.testing.assert_allclose(moved.ravel(), predicted, atol=1e-10)
    # Forces are spread by the transpose.
    force = rng.normal(size=(6, 3))
    reduced = system.reduce(unknowns.on_nodes(force), state)
    np.testing.assert_allclose(reduced[unknowns.kept], force.ravel() @ unknowns.jacobian(state), atol=1e-9)
    held = np.zeros(system.n_dofs, dtype=bool)
    held[unknowns.kept[::2]] = True
    fewer = ContactUnknowns(system, skin, SkinPatch.of_vertices(skin, np.arange(6)), held=held)
    np.testing.assert_array_equal(fewer.kept, unknowns.kept[1::2])
    np.testing.assert_allclose(fewer.jacobian(state), unknowns.jacobian(state)[:, 1::2])
