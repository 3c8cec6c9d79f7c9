"""Contact forces against finite differences of the energy, friction frames, distances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fem.block_mesh import block
from mixpinn.fem import ContactConfig, ContactModel, ProbePose, SkinSurface
from mixpinn.fem.contact.problem import ContactProblem
from mixpinn.fem.contact.surfaces import SkinPatch
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.geometry.probe_surface import ProbeSurface

MESH = block((4, 2, 4), size=(20.0, 10.0, 20.0))


def model(friction: float = 0.0) -> ContactModel:
    probe = ProbeSurface.of_probe(spherical_probe(radius=6.0, subdivisions=2), spacing=2.0)
    config = ContactConfig(friction=friction, stiffness=3.0, smoothing=0.3)
    return ContactModel(SkinSurface.of_mesh(MESH), probe, config)


def pressed(friction: float, seed: int, drag: float = 0.0) -> tuple[ContactProblem, np.ndarray]:
    """A sphere over the top of a shaken block, its lowest point 1 mm above the face, after a drag along x."""
    rng = np.random.default_rng(seed)
    contact = model(friction)
    vertices = contact.skin.vertices(MESH.points) + rng.normal(scale=0.3, size=(len(contact.skin.nodes), 3))
    pose = ProbePose(np.eye(3), np.array([9.0, 11.0, 11.5]))
    frame = contact.begin_step(vertices, pose, None)
    turned = Rotation.from_rotvec([0.0, 0.0, 0.01]).as_matrix()
    moved = ProbePose(turned, pose.translation + np.array([drag, -0.05, 0.3 * drag]))
    everything = SkinPatch.of_vertices(contact.skin, np.arange(len(contact.skin.nodes)))
    return ContactProblem(contact, everything, moved, frame), vertices


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_gradient_is_that_of_the_energy(seed: int) -> None:
    problem, vertices = pressed(0.0, seed)
    direction = np.random.default_rng(seed + 1).normal(size=vertices.shape)
    step = 1e-5
    forces = problem.evaluate(vertices)
    assert forces.hits > 0
    ahead, behind = (problem.evaluate(vertices + sign * step * direction).energy for sign in (1.0, -1.0))
    slope = (ahead - behind) / (2.0 * step)
    assert slope == pytest.approx(float((forces.gradient * direction).sum()), rel=1e-6, abs=1e-7)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([(0.0, 0.0), (0.4, 0.02), (0.4, 1.0)]))
def test_stiffness_is_the_derivative_of_the_gradient(seed: int, law: tuple[float, float]) -> None:
    friction, drag = law
    problem, vertices = pressed(friction, seed, drag)
    direction = np.random.default_rng(seed + 1).normal(size=vertices.shape)
    step = 1e-6
    ahead, behind = (problem.evaluate(vertices + sign * step * direction).gradient for sign in (1.0, -1.0))
    here = problem.evaluate(vertices)
    exact = np.zeros_like(direction)
    exact[here.touched] = (here.stiffness @ direction[here.touched].ravel()).reshape(-1, 3)
    difference = np.abs((ahead - behind) / (2.0 * step) - exact).max()
    assert difference <= 2e-4 * np.abs(exact).max()


def test_the_safe_part_of_the_stiffness_is_symmetric_and_positive() -> None:
    problem, vertices = pressed(0.4, 3, drag=1.0)
    stiffness = problem.evaluate(vertices, exact=False).stiffness
    assert np.abs(stiffness).max() > 0.1
    np.testing.assert_allclose(stiffness, stiffness.T, atol=1e-12)
    assert np.linalg.eigvalsh(stiffness)[0] >= -1e-10


@pytest.mark.parametrize(("drag", "sticks"), [(0.01, True), (1.5, False)])
def test_friction_never_exceeds_coulombs_limit(drag: float, sticks: bool) -> None:
    friction = 0.4
    problem, vertices = pressed(friction, 0, drag)
    forces = problem.evaluate(vertices)
    tangential = problem.model.config.stiffness * np.linalg.norm(forces.slip, axis=1)
    active = forces.normal_force > 0.0
    assert active.any()
    assert (tangential <= friction * forces.normal_force * (1.0 + 1e-12)).all()
    at_limit = np.isclose(tangential[active], friction * forces.normal_force[active], rtol=1e-9)
    assert at_limit.mean() < 0.7 if sticks else at_limit.mean() > 0.8


def test_contact_forces_push_the_skin_away_and_add_up() -> None:
    problem, vertices = pressed(0.0, 0)
    forces = problem.evaluate(vertices)
    total = -forces.gradient.sum(axis=0)
    assert total[1] < 0.0
    assert np.abs(total[[0, 2]]).max() < 0.5 * abs(total[1])
    assert 0.0 < forces.penetration < 2.0


def test_nothing_acts_beyond_the_gap() -> None:
    contact = model(1.0)
    vertices = contact.skin.vertices(MESH.points)
    pose = ProbePose(np.eye(3), np.array([9.0, 12.01, 11.0]))
    patch = contact.reachable(vertices, [pose], margin=4.0)
    forces = ContactProblem(contact, patch, pose, contact.begin_step(vertices, pose, None)).evaluate(
        vertices[patch.vertices],
    )
    assert forces.energy == 0.0
    assert forces.hits == 0
    assert not forces.gradient.any()


def test_patch_and_listed_vertices_surround_the_probe() -> None:
    contact = model()
    vertices = contact.skin.vertices(MESH.points)
    pose = ProbePose(np.eye(3), np.array([10.0, 12.0, 10.0]))
    patch = contact.reachable(vertices, [pose], margin=4.0)
    listed = contact.near_vertices(vertices, pose, 4.0)
    assert 0 < len(listed) <= len(patch.vertices) < len(vertices)
    assert np.isin(listed, patch.vertices).all()
    assert (vertices[patch.vertices][:, 1] == 10.0).all()
    np.testing.assert_array_equal(vertices[patch.vertices][patch.triangles].shape[1:], (3, 3))


@pytest.mark.parametrize(("height", "beneath"), [(12.0, False), (9.0, True), (3.0, True)])
def test_a_sample_on_the_wrong_side_is_noticed(height: float, beneath: bool) -> None:
    contact = model()
    vertices = contact.skin.vertices(MESH.points)
    start = ProbePose(np.eye(3), np.array([10.0, 12.0, 10.0]))
    frame = contact.begin_step(vertices, start, None)
    patch = contact.reachable(vertices, [start], margin=4.0)
    problem = ContactProblem(contact, patch, ProbePose(np.eye(3), np.array([10.0, height, 10.0])), frame)
    assert problem.tunnelled(vertices[patch.vertices]) is beneath


def test_clearance_counts_samples_inside() -> None:
    contact = model()
    vertices = contact.skin.vertices(MESH.points)
    inside, distance = contact.clearance(vertices, ProbePose(np.eye(3), np.array([10.0, 13.0, 10.0])))
    assert inside == 0
    assert distance == pytest.approx(3.0, abs=0.05)
    inside, _ = contact.clearance(vertices, ProbePose(np.eye(3), np.array([10.0, 8.0, 10.0])))
    samples = contact.probe.samples + np.array([10.0, 8.0, 10.0])
    assert inside == int(((samples > 0.0) & (samples < [20.0, 10.0, 20.0])).all(axis=1).sum())


def test_pose_between_two_poses() -> None:
    quarter = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    half = ProbePose(np.eye(3), np.zeros(3)).towards(ProbePose(quarter, np.array([2.0, 0.0, 0.0])), 0.5)
    np.testing.assert_allclose(half.rotation, Rotation.from_euler("y", 45, degrees=True).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(half.translation, [1.0, 0.0, 0.0])
