import numpy as np
import pytest

from fem.block_mesh import block
from mixpinn.fem import ContactConfig, SkinSurface
from mixpinn.fem.contact.face_kernel import bounding_capsules, nearest_on_probe, nearest_within
from mixpinn.fem.contact.faces import FaceContactModel
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.geometry.probe_surface import ProbeSurface
from mixpinn.physics.face_points import FacePoints
from mixpinn.records import Probe

GAP = 2.0
SIZE = (80.0, 20.0, 50.0)


def model(order: int, friction: float = 0.0, probe: Probe | None = None, **settings) -> FaceContactModel:
    mesh = block((5, 2, 4), size=SIZE).with_order(order)
    config = ContactConfig(gap=GAP, friction=friction, **settings)
    skin = SkinSurface.of_mesh(mesh)
    faces = np.searchsorted(skin.nodes[:, 0], mesh.skin_node_faces)
    surface = ProbeSurface.of_probe(probe or linear_probe(), spacing=config.spacing)
    return FaceContactModel.of_faces(skin, faces, skin.vertices(mesh.node_points), surface, config)


def rest(contact: FaceContactModel, order: int) -> np.ndarray:
    return contact.skin.vertices(block((5, 2, 4), size=SIZE).with_order(order).node_points)


def plate() -> Probe:
    """A flat square larger than the block."""
    corners = np.array([[-200.0, 0, -200], [200, 0, -200], [200, 0, 200], [-200, 0, 200]])
    return Probe(corners, np.array([[0, 1, 2], [0, 2, 3]]), "plate")


def level(height: float) -> ProbePose:
    return ProbePose(np.eye(3), np.array([40.0, height, 25.0]))


@pytest.mark.parametrize("width", [3, 6])
@pytest.mark.parametrize("spacing", [0.3, 0.7, 5.0])
def test_points_integrate_quadratics_and_lie_close_enough(width, spacing):
    corners = np.array([[[0.0, 0, 0], [2, 0, 0], [0.5, 1.5, 0]], [[0, 0, 0], [0, 0, 0.4], [0, 0.4, 0]]])
    points = FacePoints.build(np.arange(2 * width).reshape(2, width), corners, spacing=spacing)
    np.testing.assert_allclose(points.weights.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.bincount(points.face, points.area), [1.5, 0.08])
    loads = np.array([
        np.bincount(points.face, points.area * points.weights[:, c]) for c in range(width)
    ]).T
    share = np.full(3, 1 / 3) if width == 3 else np.array([0, 0, 0, 1 / 3, 1 / 3, 1 / 3])
    np.testing.assert_allclose(loads, np.array([1.5, 0.08])[:, None] * share, atol=1e-12)
    # Every place of a face is nearer to a point of it than the spacing.
    at = np.random.default_rng(0).dirichlet(np.ones(3), 500)
    vertex = np.concatenate([corners, 0.5 * (corners + np.roll(corners, -1, axis=1))], axis=1)[:, :width]
    for face in range(2):
        places = points.weights[points.face == face] @ vertex[face]
        distance = np.linalg.norm((at @ corners[face])[:, None] - places, axis=2).min(axis=1)
        assert distance.max() < 1.1 * spacing


def test_a_flat_plate_presses_uniformly():
    contact, depth = model(2, probe=plate()), 0.05
    x = rest(contact, 2)
    pose = level(SIZE[1] + GAP - depth)
    patch = contact.reachable(x, [pose], margin=6.0)
    found = contact.problem(patch, pose, contact.begin_step(x, pose, None)).evaluate(x[patch.vertices])
    k, delta = 500.0 / 2.0**2, 0.02
    pressure = k * (depth - 0.5 * delta)
    # Consistent loads of a uniform pressure: nothing at vertices, a third of each of their faces at midpoints.
    expected = np.zeros(len(contact.skin.nodes))
    top = np.isclose(x[contact.points.faces][:, :, 1], SIZE[1]).all(axis=1)
    area = np.bincount(contact.points.face, contact.points.area)
    np.add.at(expected, contact.points.faces[top][:, 3:], pressure * area[top][:, None] / 3.0)
    np.testing.assert_allclose(found.gradient[:, 1], expected[patch.vertices], atol=1e-9 * pressure * area.max())
    assert np.abs(found.gradient[:, [0, 2]]).max() < 1e-9 * pressure
    assert found.penetration == pytest.approx(depth)
    assert set(found.pressed) == set(np.unique(contact.points.faces[top]))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_forces_and_stiffness_are_derivatives(order, friction):
    contact, rng = model(order, friction, smoothing=0.05), np.random.default_rng(1)
    x = rest(contact, order)
    before, pose = level(SIZE[1] + GAP - 0.02), level(SIZE[1] + GAP - 0.1)
    pose = ProbePose(pose.rotation, pose.translation + np.array([0.15, 0.0, 0.05]))
    patch = contact.reachable(x, [pose], margin=6.0)
    frame = contact.begin_step(x, before, None)
    problem = contact.problem(patch, pose, frame)
    at = x[patch.vertices] + 0.02 * rng.normal(size=(len(patch.vertices), 3))
    found, h = problem.evaluate(at), 1e-6
    assert found.hits > 50
    direction = rng.normal(size=at.shape)
    ends = [problem.evaluate(at + sign * h * direction) for sign in (1.0, -1.0)]
    change = (ends[0].gradient - ends[1].gradient) / (2.0 * h)
    exact = np.zeros_like(change)
    exact[found.touched] = (found.stiffness @ direction[found.touched].ravel()).reshape(-1, 3)
    np.testing.assert_allclose(exact, change, atol=1e-5 * np.abs(change).max())
    if friction == 0.0:
        slope = (ends[0].energy - ends[1].energy) / (2.0 * h)
        assert slope == pytest.approx((found.gradient * direction).sum(), rel=1e-6)
    else:
        sliding = np.linalg.norm(found.slip, axis=1)
        assert (sliding > 0.0).any()
    loose = problem.evaluate(at, exact=False).stiffness
    np.testing.assert_allclose(loose, loose.T, atol=1e-9 * np.abs(loose).max())
    assert np.linalg.eigvalsh(loose)[0] > -1e-9 * np.abs(loose).max()


def test_friction_is_at_most_its_share_of_the_pressure():
    contact = model(2, 0.3, probe=plate())
    x, before = rest(contact, 2), level(SIZE[1] + GAP - 0.05)
    pose = ProbePose(np.eye(3), before.translation + np.array([5.0, 0.0, 0.0]))
    patch = contact.reachable(x, [before, pose], margin=6.0)
    found = contact.problem(patch, pose, contact.begin_step(x, before, None)).evaluate(x[patch.vertices])
    force = -found.gradient.sum(axis=0)
    assert force[0] == pytest.approx(-0.3 * force[1], rel=1e-9)  # the probe drags the skin along
    assert force[1] < 0.0


def test_slip_is_carried_over_and_skin_beside_the_patch_is_seen():
    contact = model(2, 1.0)
    x, pose = rest(contact, 2), level(SIZE[1] + GAP - 0.05)
    near = contact.near_vertices(x, pose, 4.0)
    patch = contact.reachable(x, [pose], margin=6.0)
    assert np.isin(near, patch.vertices).all()
    moved = ProbePose(np.eye(3), pose.translation + np.array([0.01, 0.0, 0.0]))
    problem = contact.problem(patch, moved, contact.begin_step(x, pose, None))
    slip = problem.slip_everywhere(problem.evaluate(x[patch.vertices]))
    assert slip.shape == (contact.n_points, 3)
    again = contact.problem(patch, moved, contact.begin_step(x, moved, slip)).evaluate(x[patch.vertices])
    once = problem.evaluate(x[patch.vertices])
    np.testing.assert_allclose(again.gradient, once.gradient, atol=1e-6 * np.abs(once.gradient).max())
    assert not problem.tunnelled(x[patch.vertices])
    assert problem.tunnelled(x[patch.vertices] + np.array([0.0, 5.0, 0.0]))


def test_points_that_give_way_begin_a_step_with_the_friction_that_was_carried_into_it():
    contact = model(2, 1.0)
    x, pose = rest(contact, 2), level(SIZE[1] + GAP - 0.05)
    patch = contact.reachable(x, [pose], margin=6.0)
    moved = ProbePose(np.eye(3), pose.translation + np.array([0.001, 0.0, 0.0]))  # everything sticks
    problem = contact.problem(patch, moved, contact.begin_step(x, pose, None))
    whole = problem.evaluate(x[patch.vertices])
    frame = contact.begin_step(x, moved, problem.slip_everywhere(whole))
    soft = contact.problem(patch, moved, frame, stick=1.0 / 16.0)
    found = soft.evaluate(x[patch.vertices])
    assert np.linalg.norm(whole.gradient[:, 0]) > 0.0
    np.testing.assert_allclose(found.gradient, whole.gradient, atol=1e-9 * np.abs(whole.gradient).max())
    np.testing.assert_allclose(soft.slip_everywhere(found), problem.slip_everywhere(whole), atol=1e-15)
    # Moved on, they hold by that share of the stiffness.
    on = ProbePose(np.eye(3), moved.translation + np.array([0.001, 0.0, 0.0]))
    more = contact.problem(patch, on, frame, stick=1.0 / 16.0).evaluate(x[patch.vertices])
    stiff = contact.problem(patch, on, frame).evaluate(x[patch.vertices])
    change = (more.gradient - found.gradient)[:, 0].sum(), (stiff.gradient - whole.gradient)[:, 0].sum()
    assert change[0] == pytest.approx(change[1] / 16.0, rel=1e-6)


def test_capsules_pass_over_nothing_that_is_near():
    rng = np.random.default_rng(0)
    corners, index = rng.uniform(0.0, 10.0, (30, 3)) * [1.0, 5.0, 1.0], rng.integers(0, 30, (60, 3))
    index = index[(index[:, 0] != index[:, 1]) & (index[:, 1] != index[:, 2]) & (index[:, 0] != index[:, 2])]
    capsules, every = bounding_capsules(corners[index]), np.arange(len(index))
    for point in rng.uniform(-4.0, 14.0, (300, 3)) * [1.0, 4.0, 1.0]:
        whole, some = nearest_on_probe(point, every, corners, index), nearest_within(
            point, every, corners, index, capsules, 2.0,
        )
        if whole[4] < 4.0:
            assert some == whole
        else:
            assert some[4] >= 4.0
