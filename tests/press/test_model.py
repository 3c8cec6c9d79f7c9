"""From poses to deformation: the Newton step of contact, the learned remainder, exact rigidity, files."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.evaluation import MetricGeometry, rigid_edge_error
from mixpinn.fem import SuperLUSolver
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.press.contact import PriorContact
from mixpinn.press.files import POSE_FILE, load_pose_model, save_pose_model
from mixpinn.press.fit import PoseSamples, fit_pose
from mixpinn.press.model import PoseModel
from mixpinn.press.records import ProbeGeometry
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.reduced.quadratic_features import quadratic_features
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh

UP = 40.0
"""Height of the block's top [mm]."""


@pytest.fixture(scope="module")
def hybrid():
    """A hybrid model without modes' worth of correction: the prior, and its principal coordinates."""
    mesh = block_mesh()
    prior = ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())
    size, rng = prior.coordinates.size, np.random.default_rng(0)
    readers = rng.normal(size=(4, 3 * len(prior.nodes))).astype(np.float32)
    newton = ModalNewton(
        prior, Equilibrium.of_materials(mesh, [TISSUE]), np.zeros((2, size), np.float32),
        np.zeros((2, size), np.float32),
        np.zeros((2, 3 * len(prior.nodes)), np.float32),
    )
    return HybridModel(newton, readers, np.zeros((2 + 4 + 10, 2), np.float32))


@pytest.fixture(scope="module")
def model(hybrid):
    probe = ProbeGeometry.of_probe(spherical_probe(radius=12.0, subdivisions=3))
    return PoseModel(hybrid, PriorContact.of_prior(hybrid.prior), (probe, probe))


def tip(x=18.0, z=22.0, depth=3.0):
    return np.array([[x, UP + 2.0 - depth, z]])


TURN = np.eye(3)[None]


def test_a_newton_step_of_contact_brings_it_closer_to_equilibrium(hybrid, model) -> None:
    """What is left of the balance on the loaded nodes after the step is a part of what it was before."""
    prior, equilibrium = hybrid.prior, hybrid.newton.equilibrium

    def unbalanced(steps):
        base = replace(model, steps=steps).uncorrected(TURN, tip(depth=4.0))
        held = prior.hold(base.contact.nodes)
        unknowns = prior.respond_to_forces(held, held.solve(base.contact.displacement.ravel()))
        residual = equilibrium.residual(prior.coordinates.expand(unknowns), prior.coordinates)
        residual[held.unknowns] -= base.contact.forces.ravel().astype(np.float32)
        return np.linalg.norm(residual[held.unknowns])

    assert unbalanced(1) < 0.6 * unbalanced(0)


def test_rigid_parts_stay_exactly_rigid(model) -> None:
    found = model.predict(TURN, tip(depth=5.0))
    coordinates, mesh = model.hybrid.prior.coordinates, model.hybrid.mesh
    field = np.zeros((mesh.n_points, 3))
    coordinates.place_parts(found.unknowns, field)
    error = rigid_edge_error(field, mesh.points, MetricGeometry.of(mesh).rigid_edges)
    assert error < 1e-9
    assert np.abs(found.twists).max() > 1e-3
    assert not found.displacement[mesh.fixed].any()


def test_order_does_not_matter(model) -> None:
    tips = [tip(x=12.0 + 3.0 * i, depth=1.0 + i) for i in range(4)]
    first = [model.predict(TURN, t).unknowns for t in tips]
    second = [model.predict(TURN, t).unknowns for t in tips[::-1]][::-1]
    assert_array_equal(first, second)


def test_without_contact_nothing_moves(model) -> None:
    found = model.predict(TURN, tip(depth=-1.0))
    assert not found.displacement.any()
    assert not found.wrench.any()


def test_two_probes_deform_more_than_one(model) -> None:
    both = model.predict(np.concatenate([TURN, TURN]), np.concatenate([tip(8.0, 8.0), tip(32.0, 32.0)]))
    one = model.predict(TURN, tip(32.0, 32.0))
    assert np.linalg.norm(both.displacement) > 1.2 * np.linalg.norm(one.displacement)
    assert both.wrench.shape == (2, 6)


def synthetic(model, n, seed):
    """Samples whose truth differs from the prediction by a quadratic law in one mode and in the force."""
    rng = np.random.default_rng(seed)
    size = model.hybrid.prior.coordinates.size
    coordinates = rng.normal(size=(n, 4)).astype(np.float32)
    mode = np.random.default_rng(5).normal(size=size).astype(np.float32) * 0.1
    amount = 0.3 * coordinates[:, 0] ** 2 - 0.2 * coordinates[:, 1]
    unknowns = rng.normal(size=(n, size)).astype(np.float32)
    wrench = rng.normal(size=(n, 6))
    return PoseSamples(
        coordinates, unknowns, unknowns + amount[:, None] * mode, wrench, wrench + 0.5 * coordinates[:, 2:3] ** 2,
    )


def test_the_fit_finds_a_quadratic_law(model) -> None:
    fitted = fit_pose(model, synthetic(model, 300, 1), synthetic(model, 60, 2), n_modes=3)
    asked = synthetic(model, 50, 3)
    phi = fitted.correction.features(asked.coordinates)
    field = asked.unknowns + phi @ fitted.correction.gain @ fitted.correction.modes
    assert np.abs(field - asked.truth).max() < 0.02 * np.abs(asked.unknowns - asked.truth).max()
    force = asked.wrench + phi @ fitted.correction.wrench_gain
    assert np.abs(force - asked.true_wrench).max() < 0.02 * np.abs(asked.wrench - asked.true_wrench).max()


def test_features_are_zero_at_rest_and_quadratic() -> None:
    assert not quadratic_features(np.zeros(3)).any()
    assert_allclose(quadratic_features(np.array([2.0, 3.0])), [2.0, 3.0, 4.0, 6.0, 9.0])


def test_files_keep_a_model_and_refuse_a_damaged_one(model, tmp_path) -> None:
    fitted = fit_pose(model, synthetic(model, 100, 1), synthetic(model, 30, 2), n_modes=3)
    save_pose_model(fitted, tmp_path)
    loaded = load_pose_model(tmp_path, fitted.hybrid)
    before, after = (m.predict(TURN, tip()) for m in (fitted, loaded))
    assert_array_equal(before.displacement, after.displacement)
    assert_array_equal(before.wrench, after.wrench)
    path = tmp_path / POSE_FILE
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(InputError):
        load_pose_model(tmp_path, fitted.hybrid)
    with pytest.raises(InputError):
        load_pose_model(tmp_path / "absent", fitted.hybrid)
