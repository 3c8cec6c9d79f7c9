"""The elastic prior against dense linear algebra, its exact rigidity, and its files."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.base.errors import InputError
from mixpinn.evaluation import MetricGeometry, rigid_edge_error
from mixpinn.fem import ElasticSystem, StableNeoHookean, SuperLUSolver
from mixpinn.reduced.prior import PRIOR, ElasticPrior, probed_nodes
from training.toy_block import block_mesh

TISSUE = StableNeoHookean.from_young(25.4e-3, 0.45)


@pytest.fixture(scope="module")
def mesh():
    return block_mesh()


@pytest.fixture(scope="module")
def top(mesh):
    free = (mesh.part == 0) & ~mesh.fixed
    return np.flatnonzero(free & (mesh.points[:, 1] == mesh.points[free, 1].max()))


@pytest.fixture(scope="module")
def prior(mesh, top):
    return ElasticPrior.build(mesh, [TISSUE], nodes=top, linear=SuperLUSolver(), chunk=7)


def test_imposed_displacement_gives_the_linear_solution(mesh, top, prior) -> None:
    system = ElasticSystem(mesh, [TISSUE])
    upper = system.tangent(system.rest_state(), project=False).toarray()
    stiffness = upper + np.triu(upper, 1).T
    nodes = top[::2]
    imposed = np.random.default_rng(1).normal(size=(len(nodes), 3))
    held = system.node_dofs(nodes).ravel()
    free = np.setdiff1d(np.arange(system.n_dofs), held)
    expected = np.zeros(system.n_dofs)
    expected[held] = imposed.ravel()
    expected[free] = np.linalg.solve(stiffness[np.ix_(free, free)], -stiffness[np.ix_(free, held)] @ imposed.ravel())
    unknowns, force = prior.respond(nodes, imposed)
    # The compliance is stored in single precision.
    assert_allclose(unknowns, expected, atol=2e-5 * np.abs(expected).max())
    assert_allclose(force.ravel(), (stiffness @ expected)[held], atol=1e-4 * np.abs(force).max())


def test_contact_nodes_get_what_was_imposed_and_others_follow(mesh, top, prior) -> None:
    moved = np.tile([0.0, -0.5, 0.0], (4, 1))
    field = prior.predict(top[:4], moved)
    assert_allclose(field[top[:4]], moved, atol=1e-5)
    assert not field[mesh.fixed].any()
    assert np.abs(field[mesh.part > 0]).max() > 0.0


def test_rigid_parts_keep_their_edges(mesh, top, prior) -> None:
    unknowns, _ = prior.respond(top, np.tile([0.8, -3.0, 0.4], (len(top), 1)))
    unknowns[-3:] += [0.4, -0.3, 0.5]  # a large turn
    field = prior.expand(unknowns)
    geometry = MetricGeometry.of(mesh)
    assert rigid_edge_error(field, mesh.points, geometry.rigid_edges) < 1e-6  # mm; the field is in single precision


def test_nodes_held_at_zero_count(top, prior) -> None:
    assert not prior.predict(top[:4], np.zeros((4, 3))).any()
    moved = np.array([[0.0, -0.5, 0.0], [0.0, 0.0, 0.0]])
    held, free = prior.predict(top[:2], moved), prior.predict(top[:1], moved[:1])
    assert_allclose(held[top[1]], 0.0, atol=1e-7)
    assert free[top[1], 1] < -0.05


def test_nodes_without_a_response_are_refused(mesh, top, prior) -> None:
    other = np.setdiff1d(np.flatnonzero((mesh.part == 0) & ~mesh.fixed), top)[:1]
    with pytest.raises(InputError, match=f"got node {other[0]}"):
        prior.respond(other, np.ones((1, 3)))
    with pytest.raises(InputError, match="free soft nodes"):
        ElasticPrior.build(mesh, [TISSUE], nodes=np.flatnonzero(mesh.part > 0)[:1])


def test_files_round_trip_and_refuse_another_mesh(tmp_path, mesh, top, prior) -> None:
    prior.save(tmp_path)
    moved = np.tile([0.0, -1.0, 0.0], (len(top), 1))
    assert_allclose(ElasticPrior.load(tmp_path, mesh).predict(top, moved), prior.predict(top, moved), atol=0.0)
    (tmp_path / "compliance.npy").write_bytes((tmp_path / "compliance.npy").read_bytes()[:64])
    with pytest.raises(InputError, match="make the prior again"):
        ElasticPrior.load(tmp_path, mesh)
    about = tmp_path / "prior.json"
    about.write_text(about.read_text().replace(mesh.hash(), "0" * 16))
    with pytest.raises(InputError, match="altered after it was made"):
        ElasticPrior.load(tmp_path, mesh)
    PRIOR.seal(tmp_path, ["prior.json", "compliance.npy"])
    with pytest.raises(InputError, match="build the prior for this mesh"):
        ElasticPrior.load(tmp_path, mesh)


def test_a_low_rank_prior_keeps_its_stated_error(tmp_path, mesh, top, prior) -> None:
    prior.save(tmp_path, tolerance=0.05)
    again = ElasticPrior.load(tmp_path, mesh)
    error = np.linalg.norm(again.compliance.matrix - prior.compliance.matrix) / np.linalg.norm(prior.compliance.matrix)
    assert 0.0 < error <= 0.05
    assert np.load(tmp_path / "left.npy").shape[1] < prior.compliance.shape[0] / 2
    # Contact nodes are still exactly where they are put.
    moved = np.tile([0.0, -0.7, 0.0], (6, 1))
    assert_allclose(again.predict(top[3:9], moved)[top[3:9]], moved, atol=1e-5)


def test_probed_nodes_are_those_of_whole_faces_that_begin_near_the_bones():
    mesh = block_mesh().with_order(2)
    margin = 3.0
    found = probed_nodes(mesh, margin=margin)
    bones = mesh.pressed_points[:, [0, 2]]
    low, high = bones.min(axis=0) - margin, bones.max(axis=0) + margin
    expected = set()
    for corners, nodes in zip(mesh.points[mesh.skin_faces], mesh.skin_node_faces, strict=True):
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        places = corners[:, [0, 2]]
        near = (places.max(axis=0) >= low).all() and (places.min(axis=0) <= high).all()
        if near and normal[1] > 0.0 and corners[:, 1].max() > mesh.target_points[:, 1].mean():
            expected |= set(nodes.tolist())
    assert set(found.tolist()) == {node for node in expected if not mesh.node_fixed[node]}
    assert 0 < len(found) < len(np.unique(mesh.skin_node_faces))
