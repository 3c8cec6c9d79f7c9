"""Newton steps from the cells near a contact: against all cells, and what is asked near it against the whole answer."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json, write_json
from mixpinn.fem import SuperLUSolver
from mixpinn.physics.restraints import Restraints
from mixpinn.reduced import near_cells
from mixpinn.reduced.build_prior import build_prior
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.hybrid import BUNDLE, HybridModel
from mixpinn.reduced.near_answer import NearAnswer
from mixpinn.reduced.near_cells import NearCells, cells_near
from mixpinn.reduced.outputs import Outputs
from reduced.part_of_whole import outputs_are_part_of_the_whole
from reduced.pressed_block import TISSUE, pressed_table, top_nodes
from reduced.test_restraints import JOINT, PAD, free
from training.toy_block import block_mesh

EVERYWHERE = 1e4


@pytest.fixture(scope="module")
def mesh():
    return block_mesh().with_order(2)


@pytest.fixture(scope="module")
def tied():
    return Restraints((JOINT,))


@pytest.fixture(scope="module")
def prior(mesh, tied):
    """In clusters, as of a large mesh."""
    return build_prior(
        mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver(), restraints=tied, dense_bytes=0,
    )


@pytest.fixture(scope="module")
def table(mesh, tied):
    return pressed_table(mesh, 6, restraints=tied)


@pytest.fixture(scope="module")
def model(prior, table):
    config = HybridConfig(modes=20, coordinates=4, drawn_contacts=8)
    return fit_hybrid(prior, [TISSUE], table.at_positions(range(4)), table.at_positions(range(4, 6)), config)


@pytest.fixture(scope="module")
def nearby(model, mesh):
    """The same, from cells within ten millimetres."""
    return with_reach(model, 10.0)


def with_reach(model, reach):
    near = NearCells(model.mesh, model.newton.equilibrium, model.prior.nodes, reach)
    return replace(model, newton=replace(model.newton, near=near))


def answer(model, table, index):
    contact = model.prior.hold(table.contacts(index))
    force = contact.solve(table.contact(index)[1].ravel())
    return contact, force, model.prior.respond_to_forces(contact, force)


def test_forces_are_those_of_the_equilibrium_less_their_linear_part(mesh, model) -> None:
    near = with_reach(model, EVERYWHERE).newton.near
    rng = np.random.default_rng(0)
    field = (0.3 * rng.standard_normal(mesh.node_points.shape)).astype(np.float32)
    plain, small = Equilibrium.of_materials(mesh, [TISSUE]), np.float32(2e-3)
    linear = (plain.nodal_forces(small * field) - plain.nodal_forces(-small * field)) / (2.0 * small)
    found = near.forces(field, *near.around(np.arange(3)))
    expected = plain.nodal_forces(field) - linear
    assert_allclose(found, expected, atol=2e-4 * np.abs(expected).max())


def test_from_all_cells_the_step_is_that_of_the_whole_residual(model, table) -> None:
    """But for what finite rotations of rigid parts add to linear stress, which is of second order too, and small."""
    everywhere = with_reach(model, EVERYWHERE)
    for index in range(len(table)):
        contact, _, response = answer(model, table, index)
        expected = model.newton.step(response, contact)
        found = everywhere.newton.step(response, contact)
        assert np.linalg.norm(found - expected) < 0.06 * np.linalg.norm(expected)


def test_the_step_that_remains_leads_back_what_is_linear(model, table) -> None:
    everywhere = with_reach(model, EVERYWHERE)
    for index in range(len(table)):
        state = model.solve(*table.contact(index))
        beyond = state.unknowns - state.response
        expected = model.newton.step(state.unknowns, state.contact, beyond)
        found = everywhere.newton.step(state.unknowns, state.contact, beyond)
        assert np.linalg.norm(found - expected) < 0.05 * np.linalg.norm(state.step)


def test_farther_cells_count_less_and_then_nothing(mesh, nearby) -> None:
    near, prior = nearby.newton.near, nearby.prior
    corner = int(np.linalg.norm(mesh.node_points[prior.nodes] - mesh.points.min(axis=0), axis=1).argmin())
    blocks, weights = near.around(3 * corner + np.arange(3))
    assert 0 < len(blocks) < len(near.around(np.arange(3 * len(prior.nodes)))[0])
    assert ((weights > 0.0) & (weights <= 1.0)).all()
    assert weights.max() == 1.0
    field = 0.1 * mesh.node_points.astype(np.float32) ** 2 / 40.0
    forces = near.forces(field, blocks, weights)
    touched = np.flatnonzero(np.abs(forces).max(axis=1) > 0.0)
    assert np.isin(touched, near.nodes_of(blocks, mesh.n_nodes)).all()
    away = np.linalg.norm(mesh.node_points[touched] - mesh.node_points[prior.nodes[corner]], axis=1)
    assert away.max() < 0.8 * np.linalg.norm(np.ptp(mesh.points, axis=0))


def test_joints_count_beyond_their_stiffness_at_rest(model) -> None:
    """Twists a tenth as large leave a hundredth of it: what is linear is gone."""
    near, count = with_reach(model, 4.0).newton.near, model.mesh.n_parts
    twists = np.random.default_rng(1).normal(size=(count, 6)) * [0.3, 0.3, 0.3, 0.05, 0.05, 0.05]
    large, small = near.wrenches(twists), near.wrenches(0.1 * twists)
    assert np.abs(large).max() > 0.0
    assert np.linalg.norm(small) < 0.02 * np.linalg.norm(large)


def test_asked_near_the_contact_the_step_is_the_same(nearby, table) -> None:
    near = NearAnswer(nearby.newton)
    for index in range(len(table)):
        contact, force, response = answer(nearby, table, index)
        expected = nearby.newton.step(response, contact)
        assert_allclose(near.step(contact, force), expected, atol=1e-4 * np.abs(expected).max())


def test_outputs_are_that_part_of_the_whole(nearby, table) -> None:
    outputs_are_part_of_the_whole(nearby, table, within=1e-5)


def test_outputs_of_the_prior_alone_are_that_part_of_it(prior, table, mesh) -> None:
    bare = HybridModel.of_prior(prior, Equilibrium.of_materials(mesh, [TISSUE], prior.restraints))
    chosen = np.random.default_rng(2).permutation(mesh.n_nodes)[:60]
    for index in (0, len(table) - 1):
        whole, found = prior.predict(*table.contact(index)), Outputs(bare, chosen).predict(*table.contact(index))
        assert_allclose(found, whole[chosen], atol=1e-5 * np.abs(whole).max())


def test_a_bundle_keeps_how_far_cells_count(nearby, model, table, mesh, tmp_path) -> None:
    for each, reach in ((nearby, 10.0), (model, None)):
        each.save(tmp_path / str(reach))
        again = HybridModel.load(tmp_path / str(reach), mesh)
        assert (None if again.newton.near is None else again.newton.near.reach) == reach
        assert_array_equal(again.predict(*table.contact(1)), each.predict(*table.contact(1)))


@pytest.mark.parametrize("reach", [-1.0, 0.0, float("nan"), float("inf"), "far"])
def test_a_reach_that_is_no_length_is_refused(nearby, mesh, tmp_path, reach) -> None:
    nearby.save(tmp_path)
    write_json(tmp_path / "hybrid.json", {**read_json(tmp_path / "hybrid.json"), "near": reach})
    BUNDLE.seal_more(tmp_path, ["hybrid.json"])
    with pytest.raises(InputError, match=r"near|finite"):
        HybridModel.load(tmp_path, mesh)


def test_only_meshes_of_many_quadratic_cells_without_foundations_leave_cells_out(
    mesh, model, tied, prior, monkeypatch,
) -> None:
    assert cells_near(mesh, model.newton.equilibrium, prior.nodes) is None
    monkeypatch.setattr(near_cells, "_ALL_CELLS", 10)
    assert cells_near(mesh, model.newton.equilibrium, prior.nodes) is not None
    linear = mesh.with_order(1)
    assert cells_near(linear, Equilibrium.of_materials(linear, [TISSUE], tied), top_nodes(linear)) is None
    loose = free(mesh)
    padded = Equilibrium.of_materials(loose, [TISSUE], Restraints((JOINT,), (PAD,)))
    assert cells_near(loose, padded, prior.nodes) is None


def test_a_fit_on_many_cells_is_about_as_good(mesh, prior, table, model, monkeypatch) -> None:
    monkeypatch.setattr(near_cells, "_ALL_CELLS", 10)
    monkeypatch.setattr(near_cells, "_REACH", 10.0)
    config = HybridConfig(modes=20, coordinates=4, drawn_contacts=8)
    found = fit_hybrid(prior, [TISSUE], table.at_positions(range(4)), table.at_positions(range(4, 6)), config)
    assert found.newton.near is not None

    def error(one):
        return np.mean([
            np.linalg.norm(one.predict(*table.contact(i)) - table.displacement[i], axis=1).mean() for i in (4, 5)
        ])

    assert error(found) < max(1.5 * error(model), 1.02 * error(prior))
