"""Contact from the pose: balance, friction, independence of order, several probes, and the full contact simulation."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.fem import PoseSimulator, Scene, SkinSurface, SuperLUSolver
from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.geometry.proximity import proximity
from mixpinn.press.contact import PriorContact
from mixpinn.press.probe_field import ProbeField
from mixpinn.press.records import PlacedFields, PoseContactConfig
from mixpinn.records import ProbePath
from mixpinn.reduced.prior import ElasticPrior
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh

UP = 40.0
"""Height of the block's top [mm]."""


@pytest.fixture(scope="module")
def mesh():
    return block_mesh()


@pytest.fixture(scope="module")
def prior(mesh):
    return ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())


@pytest.fixture(scope="module")
def ball():
    return field_of(spherical_probe(radius=12.0, subdivisions=3))


def field_of(probe):
    return ProbeField.of_probe(probe, gap=2.0)


def pose(x=18.0, z=22.0, depth=3.0, turn=0.0):
    """Rotation and tip of one probe whose gap of 2 mm reaches `depth` into the undeformed block."""
    cosine, sine = np.cos(turn), np.sin(turn)
    rotation = np.array([[[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]])
    return rotation, np.array([[x, UP + 2.0 - depth, z]])


def test_forces_balance_the_linear_body_and_the_probe(prior, ball) -> None:
    found = PriorContact.of_prior(prior).solve([ball], *pose())
    assert found.converged
    held = prior.hold(found.nodes)
    expected = held.solve(found.displacement.ravel())
    assert_allclose(expected, found.forces.ravel(), atol=1e-3 * np.abs(found.forces).max())
    assert_allclose(found.wrench[0, :3], -found.forces.sum(axis=0), atol=1e-9)
    assert found.wrench[0, 1] > 1.0  # the tissue pushes the probe back up


def test_the_skin_keeps_the_gap_and_nothing_pulls(mesh, prior, ball) -> None:
    rotation, tip = pose(depth=4.0)
    found = PriorContact.of_prior(prior, PoseContactConfig(stiffness=40.0)).solve([ball], rotation, tip)
    top = prior.nodes
    x = mesh.points.copy()
    x[top] += (prior.own_compliance @ -found.history.force.ravel()).reshape(-1, 3)
    skin = SkinSurface.of_mesh(mesh)
    near = proximity(ball.probe.points + tip, skin.vertices(x), skin.surface, cutoff=4.0)
    # Between its contact points the skin's triangles may come closer than the gap to a ball of so small a radius.
    assert near.distance.min() > 1.7
    assert (found.forces[:, 1] < 1e-9).all()


def test_nothing_touches_above_the_gap(prior, ball) -> None:
    found = PriorContact.of_prior(prior).solve([ball], *pose(depth=-0.1))
    assert not len(found.nodes)
    assert not found.wrench.any()
    assert found.converged


def test_answers_do_not_depend_on_what_was_asked_before(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    poses = [pose(x=12.0 + 2.0 * i, depth=1.0 + i % 3) for i in range(6)]
    forwards = [contact.solve([ball], *place).wrench for place in poses]
    backwards = [contact.solve([ball], *place).wrench for place in poses[::-1]][::-1]
    assert_array_equal(forwards, backwards)


def test_force_grows_with_depth(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    push = [contact.solve([ball], *pose(depth=depth)).wrench[0, 1] for depth in np.arange(0.5, 8.0, 0.5)]
    assert (np.diff(push) > 0.0).all()


def test_history_remembers_where_the_probe_stuck(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    first = contact.solve([ball], *pose())
    same = contact.solve([ball], *pose(), history=first.history)
    assert_allclose(same.wrench, first.wrench, rtol=1e-3, atol=1e-3)
    moved = contact.solve([ball], *pose(x=18.4), history=first.history)
    fresh = contact.solve([ball], *pose(x=18.4))
    # Dragged towards +x, the tissue pulls the probe back.
    assert moved.wrench[0, 0] < fresh.wrench[0, 0] - 0.05
    smooth = PriorContact.of_prior(prior, PoseContactConfig(friction=0.0))
    start = smooth.solve([ball], *pose())
    dragged = smooth.solve([ball], *pose(x=18.4), history=start.history)
    assert abs(dragged.wrench[0, 0] - smooth.solve([ball], *pose(x=18.4)).wrench[0, 0]) < 0.02


def test_friction_stays_within_its_cone(prior, ball) -> None:
    contact = PriorContact.of_prior(prior, PoseContactConfig(friction=0.2))
    history = contact.solve([ball], *pose(depth=2.0)).history
    for x in np.linspace(18.0, 22.0, 9):
        found = contact.solve([ball], *pose(x=x, depth=2.0), history=history)
        history = found.history
    # The ball has long slid. Its normals lean, so that the cone is a little wider than μ; all of it slides.
    assert found.sliding[0] > 0.9
    assert np.hypot(*found.wrench[0, [0, 2]]) < 0.6 * found.wrench[0, 1]


def test_several_probes_press_together(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    first, second = pose(x=8.0, z=8.0, depth=2.0), pose(x=32.0, z=32.0, depth=3.0)
    both = contact.solve([ball, ball], np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]]))
    swapped = contact.solve([ball, ball], np.concatenate([second[0], first[0]]), np.concatenate([second[1], first[1]]))
    assert both.converged
    assert_allclose(both.wrench, swapped.wrench[::-1], rtol=1e-2)
    assert_allclose(both.wrench[:, :3].sum(axis=0), -both.forces.sum(axis=0), atol=1e-9)
    assert_allclose(both.shares.sum(axis=0), both.forces, atol=1e-9)
    alone = contact.solve([ball], *second)
    # The other probe pulls the skin down beside this one: it meets a little less of it.
    assert 0.7 * alone.wrench[0, 1] < both.wrench[1, 1] < alone.wrench[0, 1]


def test_a_turned_scene_gives_the_turned_answer(mesh, prior, ball) -> None:
    """A probe that comes down at an angle pushes along its own axis."""
    rotation, tip = pose(depth=3.0, turn=0.3)
    found = PriorContact.of_prior(prior).solve([ball], rotation, tip)
    axis = rotation[0] @ [0.0, -1.0, 0.0]
    assert found.wrench[0, :3] @ axis < 0.0
    sideways = found.wrench[0, 0] / found.wrench[0, 1]
    assert np.sign(sideways) == np.sign(axis[0] / axis[1])


@pytest.mark.parametrize("depth", [1.0, 2.0])
def test_it_meets_the_full_contact_simulation_where_the_body_is_nearly_linear(mesh, prior, depth) -> None:
    probe = linear_probe(length=22.0, width=14.0, height=20.0, radius=3.0)
    scene = Scene(mesh, probe, (TISSUE,))
    steps = np.arange(0.0, depth + 1e-9, 0.5)
    tips = np.stack([np.full(len(steps), 20.0), UP + 2.0 - steps, np.full(len(steps), 21.0)], axis=1)
    path = ProbePath(tips, np.tile(np.eye(3), (len(steps), 1, 1)), steps)
    true = PoseSimulator(scene, linear=SuperLUSolver()).run(path)
    assert true.converged.all()
    found = PriorContact.of_prior(prior).solve([field_of(probe)], np.eye(3)[None], tips[-1:])
    assert_allclose(found.wrench[0, 1], true.probe_wrench[-1, 1], rtol=0.1)
    held = prior.hold(found.nodes)
    field = prior.expand(prior.respond_to_forces(held, found.forces.ravel()))
    error = np.linalg.norm(field - true.displacement[-1], axis=1).mean()
    assert error < 0.1 * np.linalg.norm(true.displacement[-1], axis=1).mean()


def test_it_meets_the_full_contact_simulation_of_quadratic_cells(mesh) -> None:
    curved = mesh.with_order(2)
    probe, depth = linear_probe(length=22.0, width=14.0, height=20.0, radius=3.0), 2.0
    steps = np.arange(0.0, depth + 1e-9, 0.5)
    tips = np.stack([np.full(len(steps), 20.0), UP + 2.0 - steps, np.full(len(steps), 21.0)], axis=1)
    path = ProbePath(tips, np.tile(np.eye(3), (len(steps), 1, 1)), steps)
    true = PoseSimulator(Scene(curved, probe, (TISSUE,)), linear=SuperLUSolver()).run(path)
    bent = ElasticPrior.build(curved, [TISSUE], nodes=top_nodes(curved), linear=SuperLUSolver())
    found = PriorContact.of_prior(bent).solve([field_of(probe)], np.eye(3)[None], tips[-1:])
    assert_allclose(found.wrench[0, 1], true.probe_wrench[-1, 1], rtol=0.06)  # the softer penalty gives way


def test_the_rim_of_the_skin_is_where_it_goes_on_not_where_the_body_ends(mesh, prior, ball) -> None:
    top = top_nodes(mesh)
    half = top[mesh.points[top][:, 0] <= 20.0]
    whole = PriorContact.of_prior(prior)
    part = PriorContact.of_prior(ElasticPrior.build(mesh, [TISSUE], nodes=half, linear=SuperLUSolver()))
    rim = float(mesh.points[half][:, 0].max())
    border = float(mesh.points[top][:, 0].min())

    def reaches(contact, x):
        rotation, tip = pose()
        tip[0, 0] = x
        found = contact.solve([ball], rotation, tip)
        assert len(found.nodes)
        return contact.at_the_rim(found)

    assert reaches(part, rim - 1.0)
    # Its last face is touched, whose nodes lie on the rim and carry force, but not beside the rim.
    assert not reaches(part, rim - 9.0)
    assert not reaches(whole, rim - 1.0)
    assert not reaches(whole, border + 1.0)


def test_bad_poses_are_refused(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    rotation, tip = pose()
    for turns, places in (
        (rotation, np.array([[np.nan, 0.0, 0.0]])), (2.0 * rotation, tip), (rotation[0], tip), (rotation[:0], tip[:0]),
        (rotation * [1.0, 1.0, -1.0], tip),
    ):
        with pytest.raises(InputError):
            contact.solve([ball] * len(places), turns, places)
    with pytest.raises(InputError):
        contact.solve([ball, ball], np.concatenate([rotation] * 2), np.concatenate([tip] * 2),
                      history=contact.solve([ball], rotation, tip).history)


def test_answers_along_a_press_are_one_path(prior, ball) -> None:
    """Just before and just after a whole number of steps the answers are the same, and everywhere they are steady."""
    contact = PriorContact.of_prior(prior)
    touch = -float(contact.depth([ball], *pose(depth=0.0))[0])
    step = contact.config.step
    for depth in (touch + step, touch + 2.0 * step):
        before, after = (contact.solve([ball], *pose(depth=depth + by)).wrench for by in (-1e-6, 1e-6))
        assert_allclose(after, before, rtol=2e-3, atol=2e-3)
    depths = np.arange(0.0, 8.0, 0.1)
    force = np.array([contact.solve([ball], *pose(depth=depth)).wrench[0, :3] for depth in depths])
    assert (np.diff(force[:, 1]) > -0.01).all()
    steps = np.linalg.norm(np.diff(force, axis=0), axis=1)
    assert steps.max() < 4.0 * np.median(steps[steps > 0.0])


def test_paths_go_in_steps_of_one_millimetre_from_first_touch(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    rotations, translations = pose(depth=5.0)
    depths = contact.depth([ball], rotations, translations)
    turns, places = contact._path_down(PlacedFields((ball,), rotations, translations), depths)
    along = (places[:, 0] - places[0, 0]) @ np.array([0.0, -1.0, 0.0])
    assert_allclose(along, np.append(np.arange(0.0, depths[0]), depths[0]), atol=1e-9)
    assert_array_equal(places[-1], translations)
    assert (turns == rotations).all()


def test_depth_counts_from_first_touch(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    deep = [contact.depth([ball], *pose(depth=depth))[0] for depth in (0.0, 2.0, 30.0)]
    assert_allclose(np.diff(deep), [2.0, 28.0], atol=1e-9)
    assert contact.depth([ball], *pose(x=500.0))[0] == -np.inf
    # The flat block is first touched by the lowest of the ball, up to the distance between contact points.
    assert -0.3 < deep[0] < 0.01


def test_a_steep_tilt_and_a_deep_press_converge(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    for turn in (-0.5, 0.0, 0.5):
        for depth in (6.0, 12.0):
            found = contact.solve([ball], *pose(depth=depth, turn=turn))
            assert found.converged
            assert np.isfinite(found.wrench).all()


@pytest.mark.parametrize("order", [1, 2])
def test_a_contact_of_curved_faces_gives_way_and_one_of_flat_faces_keeps_its_settings(order) -> None:
    config = PoseContactConfig.of_order(order, gap=1.5, friction=0.4)
    assert (config.gap, config.friction) == (1.5, 0.4)
    assert (replace(config, gap=2.0, friction=1.0) == PoseContactConfig()) == (order == 1)


def test_where_no_step_converges_contact_stays_as_it_was_and_says_so(prior, ball) -> None:
    contact = PriorContact.of_prior(prior)
    rotation, tip = pose(depth=3.0)
    session = contact.open([ball], rotation, tip)
    before = session.outcome()
    assert before.converged
    impatient = PriorContact.of_prior(prior, PoseContactConfig(max_iterations=0))
    deeper = np.stack([tip, pose(depth=4.0)[1]])
    lost = replace(session, contact=impatient).go((np.stack([rotation, rotation]), deeper))
    assert lost.lost
    after = lost.outcome()
    assert not after.converged
    assert_array_equal(after.nodes, before.nodes)
    assert_array_equal(after.displacement, before.displacement)
    assert_allclose(after.wrench[0, :3], before.wrench[0, :3])
    assert_allclose(after.shares.sum(axis=0), after.forces, atol=1e-2 * np.abs(after.forces).max())
