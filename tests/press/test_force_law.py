"""The force of a probe as learned: what a grip tells, that the skin goes with the force, and which laws are found."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.fem import SuperLUSolver
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.files import load_pose_model, save_pose_model
from mixpinn.press.fit import collect, fit_pose
from mixpinn.press.fit_forces import with_force_law
from mixpinn.press.force_law import TERMS, ForceLaw, with_forces
from mixpinn.press.grip import SIGNS, Grip
from mixpinn.press.model import PoseModel
from mixpinn.records import SampleTable
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.prior import ElasticPrior
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh

TURN = rotation_from_vector(np.array([0.0, 0.3, 0.1]))
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def model():
    mesh = block_mesh()
    prior = ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())
    size, rows = prior.coordinates.size, 3 * len(prior.nodes)
    nothing = Rows.of(np.zeros((0, size)))
    newton = ModalNewton(
        prior, Equilibrium.of_materials(mesh, [TISSUE]), nothing, nothing, np.zeros((0, rows), np.float32),
    )
    readers = np.random.default_rng(0).normal(size=(4, rows)).astype(np.float32)
    hybrid = HybridModel(newton, readers, np.zeros((14, 0), np.float32))
    contact = PriorContact.of_prior(prior)
    probe = contact.field(linear_probe(length=22.0, width=14.0, height=20.0, radius=3.0))
    return PoseModel(hybrid, contact, (probe,), PoseDomain.of_mesh(mesh), steps=0)


def tip(x=18.0, z=21.0, depth=3.0):
    return np.array([x, 42.0 - depth, z])


def grip_of(model, place, turn=TURN):
    contact = model.touch(turn[None], place[None]).contact
    return contact, Grip.of_contact(model.hybrid, contact, turn[None])


def a_law():
    along = np.zeros(SIGNS)
    along[:2] = -0.1, 0.4
    across = np.zeros((2, TERMS))
    across[:, 1], across[:, 2] = (0.9, 1.2), (0.3, 0.5)
    return ForceLaw(along, np.array([1.0]), AXES, across)


def test_what_presses_does_not_move_across_under_the_force_that_holds_it(model) -> None:
    _, grip = grip_of(model, tip(x=14.0))
    moved = (grip.response @ (grip.push * grip.along[0] + grip.held[0])).reshape(-1, 3)
    mean = grip.weights[0] @ moved
    free = grip.weights[0] @ (grip.response @ (grip.push * grip.along[0])).reshape(-1, 3)
    assert mean @ grip.along[0] > 1.0
    assert_allclose(mean @ TURN[:, [0, 2]], 0.0, atol=1e-9)
    assert np.abs(free @ TURN[:, [0, 2]]).max() > 1e-3
    assert_allclose([grip.held[0] @ grip.along[0], grip.across[0] @ grip.along[0]], 0.0, atol=1e-9)


def test_what_the_newton_step_tells_is_of_second_order(model) -> None:
    contact, whole = grip_of(model, tip(x=14.0))
    small, smaller = (
        Grip.of_contact(model.hybrid, replace(
            contact, forces=share * contact.forces, shares=share * contact.shares,
        ), TURN[None]) for share in (0.02, 0.01)
    )
    assert_allclose(small.held, 0.02 * whole.held, rtol=1e-9)
    assert_allclose(smaller.eased, 0.25 * small.eased, rtol=0.1)
    assert_allclose(smaller.signs[0, 8], 0.5 * small.signs[0, 8], rtol=0.1)
    assert np.linalg.norm(whole.eased) > 0.0


def test_the_skin_goes_with_the_force(model) -> None:
    contact, grip = grip_of(model, tip())
    prior, force = model.hybrid.prior, np.array([[0.3, -2.0, 0.1]])
    places = prior.mesh.node_points[contact.nodes]
    found = with_forces(contact, grip, force, places, tip()[None])
    assert_allclose(found.wrench[0, :3], -force[0], atol=1e-9)
    assert_allclose(found.forces.sum(axis=0), force[0], atol=1e-9)
    held = prior.hold(found.nodes).solve(found.displacement.ravel())
    assert_allclose(held, found.forces.ravel(), atol=2e-3 * np.abs(found.forces).max())
    same = with_forces(contact, grip, contact.shares[0].sum(axis=0)[None], places, tip()[None])
    assert_allclose(same.wrench, contact.wrench, atol=1e-7)  # moments of nodes are those of the contact points
    assert_allclose(same.displacement, contact.displacement, atol=1e-12)


def test_the_way_down_is_the_straight_one_with_a_history_too(model) -> None:
    learned, history = replace(model, law=a_law()), None
    for depth in (1.0, 2.0, 3.0):
        way = tip() + (3.0 - depth) * TURN[:, 1]  # along the probe's axis
        stepped = learned.touch(TURN[None], way[None], history=history)
        history = stepped.contact.history
    straight = learned.touch(TURN[None], way[None])
    assert straight.learned
    assert_allclose(stepped.contact.wrench[0, :3], straight.contact.wrench[0, :3], atol=2e-3)
    assert_allclose(history.dragged, 0.0, atol=1e-9)


def test_a_drag_pulls_by_the_compliance_of_the_patch_until_it_slides(model) -> None:
    learned = replace(model, law=a_law())
    first = learned.touch(TURN[None], tip()[None]).contact
    aside = TURN[:, 0]
    after = learned.touch(TURN[None], (tip() + 0.4 * aside)[None], history=first.history).contact
    contact = model.touch(TURN[None], (tip() + 0.4 * aside)[None], history=model.touch(
        TURN[None], tip()[None]).contact.history).contact
    before = model.touch(TURN[None], tip()[None]).contact
    pulled = -(after.wrench - first.wrench)[0, :3] @ aside
    assert pulled > 0.05
    assert_allclose(pulled, -(contact.wrench - before.wrench)[0, :3] @ aside, rtol=0.3)  # as contact points pull
    assert_allclose(after.history.dragged[0], 0.4 * aside, atol=1e-9)
    grip = Grip.of_contact(model.hybrid, before, TURN[None])
    assert_allclose(grip.way_of(grip.force_of(0.4 * aside[None])), 0.4 * aside[None], atol=1e-9)
    forces, held = a_law().forces(grip, 50.0 * aside[None], friction=0.5)
    along = forces @ grip.along[0]
    leaning = forces - along[:, None] * grip.along
    assert_allclose(np.linalg.norm(leaning, axis=1), 0.5 * along, rtol=1e-9)
    assert 0.0 < np.linalg.norm(held) < 50.0
    again, same = a_law().forces(replace(grip, across=grip.across + grip.force_of(held)), held, friction=0.5)
    reference, _ = a_law().forces(grip)
    straight = reference - (reference @ grip.along[0])[:, None] * grip.along
    assert_allclose(again - along[:, None] * grip.along, straight + grip.force_of(held), atol=1e-6)
    assert_allclose(same, held, rtol=1e-6)


def test_probes_far_apart_and_none_at_all(model) -> None:
    learned = replace(model, law=a_law(), probes=(model.probes[0],) * 2)
    high = learned.touch(np.stack([TURN, TURN]), np.stack([tip(), tip(depth=-30.0)]))
    alone = learned.touch(TURN[None], tip()[None])
    assert_allclose(high.contact.wrench[0], alone.contact.wrench[0], atol=1e-9)
    assert not high.contact.wrench[1].any()
    none = learned.predict(TURN[None], tip(depth=-1.0)[None])
    assert not none.displacement.any()


def simulated(model, law, *, noise=0.0):
    """A table of presses at eight places whose forces and fields are those of `law`, its forces with noise."""
    rng, learned = np.random.default_rng(3), replace(model, law=law)
    group, depths, tips, wrenches, fields = [], [], [], [], []
    for place in range(8):
        x, z = 12.0 + 2.0 * place, 26.0 - 1.5 * place
        for depth in (1.0, 2.0, 3.0, 4.0):
            at = tip(x=x, z=z, depth=depth)
            found = learned.predict(TURN[None], at[None])
            size = np.linalg.norm(found.wrench[0, :3])
            group.append(place)
            depths.append(depth)
            tips.append(at)
            wrenches.append(found.wrench[0] + noise * size * np.append(rng.normal(size=3), np.zeros(3)))
            fields.append(found.displacement)
    n = len(group)
    return SampleTable(
        model.hybrid.mesh.hash(), np.array(group), np.zeros(n), np.array(depths), np.array(tips),
        np.tile(TURN, (n, 1, 1)), np.arange(n + 1), np.zeros(n, dtype=np.int64), np.zeros((n, 3)), np.array(wrenches),
        np.array(fields, dtype=np.float32),
    )


def test_a_law_is_found_where_forces_follow_one_and_kept_with_the_model(model, tmp_path) -> None:
    law = a_law()
    table = simulated(model, law)
    samples = collect(model, table)
    found, learned = with_force_law(model, samples)
    before, after = (np.linalg.norm(each.missed_wrench[:, :3], axis=1).mean() for each in (samples, learned))
    assert after < 0.1 * before
    new = tip(x=17.3, z=22.7, depth=2.6)
    true = replace(model, law=law).touch(TURN[None], new[None]).contact.wrench[0, :3]
    plain = model.touch(TURN[None], new[None]).contact.wrench[0, :3]
    left = np.linalg.norm(found.touch(TURN[None], new[None]).contact.wrench[0, :3] - true)
    assert left < 0.1 * np.linalg.norm(plain - true)
    fitted = fit_pose(found, learned, n_modes=3)
    fitted.hybrid.mesh.save(tmp_path / "mesh.vtu")
    save_pose_model(fitted, tmp_path)
    loaded = load_pose_model(tmp_path, model.hybrid)
    first, second = (each.predict(TURN[None], new[None]) for each in (fitted, loaded))
    assert_array_equal(first.displacement, second.displacement)
    assert_array_equal(first.wrench, second.wrench)


def test_a_law_tells_the_force_alone_where_the_body_follows_contact_nodes_better(model, tmp_path) -> None:
    law = a_law()
    table = simulated(model, law)
    plain = [
        model.predict(turn[None], place[None]).displacement
        for turn, place in zip(table.probe_rotation, table.probe_translation, strict=True)
    ]
    samples = collect(model, replace(table, displacement=np.array(plain)))
    found, learned = with_force_law(model, samples)
    assert found.law is not None
    assert not found.law.moves
    assert_array_equal(learned.missed, samples.missed)
    new = tip(x=17.3, z=22.7, depth=2.6)
    true, before = (replace(model, law=one).predict(TURN[None], new[None]) for one in (law, None))
    after = found.predict(TURN[None], new[None])
    assert_array_equal(after.displacement, before.displacement)
    left, was = (np.linalg.norm((each.wrench - true.wrench)[0, :3]) for each in (after, before))
    assert left < 0.1 * was
    found.hybrid.mesh.save(tmp_path / "mesh.vtu")
    save_pose_model(found, tmp_path)
    loaded = load_pose_model(tmp_path, model.hybrid)
    assert loaded.law is not None
    assert not loaded.law.moves


def test_no_law_is_kept_where_the_contact_is_right(model) -> None:
    plain = replace(model, law=None)
    samples = collect(plain, simulated(plain, None))
    found, same = with_force_law(plain, samples)
    assert found.law is None
    assert same is samples
    few = samples.select(np.flatnonzero(samples.group < 3))
    assert with_force_law(plain, few)[1] is few
