"""From poses to deformation: the Newton step of contact, the learned remainder, exact rigidity, files."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.errors import InputError
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.evaluation import MetricGeometry, rigid_edge_error
from mixpinn.fem import PoseSimulator, Scene, SuperLUSolver
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.files import POSE_FILE, load_pose_model, save_pose_model
from mixpinn.press.fit import PoseSamples, _blind, fit_pose, fitted_bend
from mixpinn.press.model import PoseModel, Uncorrected
from mixpinn.press.records import ContactHistory, ContactPrediction
from mixpinn.records import ProbePath
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import BUNDLE, HybridModel
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.reduced.quadratic_features import quadratic_features
from reduced.pressed_block import TISSUE, pressed_table, top_nodes
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
        prior, Equilibrium.of_materials(mesh, [TISSUE]), Rows.of(np.zeros((2, size))),
        Rows.of(np.zeros((2, size))),
        np.zeros((2, 3 * len(prior.nodes)), np.float32),
    )
    return HybridModel(newton, readers, np.zeros((2 + 4 + 10, 2), np.float32))


@pytest.fixture(scope="module")
def model(hybrid):
    contact = PriorContact.of_prior(hybrid.prior)
    probe = contact.field(spherical_probe(radius=12.0, subdivisions=3))
    return PoseModel(hybrid, contact, (probe, probe), PoseDomain.of_mesh(hybrid.mesh))


def tip(x=18.0, z=22.0, depth=3.0):
    return np.array([[x, UP + 2.0 - depth, z]])


TURN = np.eye(3)[None]


def test_a_newton_step_of_contact_brings_it_closer_to_the_full_solve(hybrid, model) -> None:
    depths = np.arange(1.0, 7.0)
    tips = np.concatenate([tip(depth=depth) for depth in depths])
    scene = Scene(hybrid.mesh, spherical_probe(radius=12.0, subdivisions=3), (TISSUE,))
    path = ProbePath(tips, np.repeat(TURN, len(depths), axis=0), depths)
    true = PoseSimulator(scene, linear=SuperLUSolver()).run(path)
    assert true.converged.all()

    def wrong(steps):
        found = replace(model, steps=steps).uncorrected(TURN, tips[-1:])
        return np.linalg.norm(found.contact.wrench[0, :3] - true.probe_wrench[-1, :3])

    assert wrong(1) < 0.5 * wrong(0)


def test_a_newton_step_of_which_nothing_is_taken_is_not_computed(model, monkeypatch) -> None:
    linear = replace(model, steps=0).predict(TURN, tip(depth=5.0))
    monkeypatch.setattr("mixpinn.press.model.newton_shift", None)
    unbent = replace(model, bend=0.0).predict(TURN, tip(depth=5.0))
    assert_array_equal(unbent.displacement, linear.displacement)
    assert_array_equal(unbent.wrench, linear.wrench)
    assert not unbent.contact.history.lead.any()  # a path that goes on from there goes on from these forces


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
    assert found.trust.sound
    assert "touches nothing" in " ".join(found.trust.reasons)


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
    base = [
        Uncorrected(touching(wrench[i]), unknowns[i], coordinates[i], coordinates[i][None], 0.1, 0.1) for i in range(n)
    ]
    return PoseSamples(
        base, unknowns + amount[:, None] * mode, wrench + 0.5 * coordinates[:, 2:3] ** 2, np.arange(n) // 4,
        np.tile(np.eye(3), (n, 1, 1)), rng.uniform(10.0, 30.0, (n, 3)),
    )


def touching(wrench):
    """A contact of one node with this wrench (6,)."""
    none, one = np.empty((0, 3)), np.zeros((1, 3))
    history = ContactHistory(
        TURN, one, none, none, np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), none, np.empty(0),
    )
    return ContactPrediction(
        np.array([0]), one, one, one[None], wrench[None], np.zeros(1), np.array([5.0]), history, True, 1,
    )


def test_the_fit_finds_a_quadratic_law(model) -> None:
    fitted = fit_pose(model, synthetic(model, 300, 1), n_modes=3)
    asked = synthetic(model, 50, 3)
    left, before = 0.0, 0.0
    for base, truth, true_wrench in zip(asked.base, asked.truth, asked.true_wrench, strict=True):
        phi = fitted.correction.features(base.coordinates)
        field = base.unknowns + phi @ fitted.correction.gain @ fitted.correction.modes
        left = max(left, np.abs(field - truth).max())
        before = max(before, np.abs(base.unknowns - truth).max())
        assert_allclose(base.contact.wrench[0] + phi @ fitted.correction.wrench_gain, true_wrench, atol=0.05)
    assert left < 0.02 * before


def test_a_correction_stays_a_limited_part_of_the_whole(model) -> None:
    fitted = fit_pose(model, synthetic(model, 100, 1), n_modes=3)
    base = synthetic(model, 1, 7).base[0]
    far = replace(base, coordinates=1e3 * base.coordinates, of_probes=1e3 * base.of_probes)
    unknowns, wrench = fitted.corrected(far)
    weights = fitted.hybrid.prior.coordinates.weights
    size = np.linalg.norm(weights * (unknowns - base.unknowns)) / np.linalg.norm(weights * base.unknowns)
    assert size <= 1.01 * fitted.correction.largest[0]
    change = np.linalg.norm((wrench - base.contact.wrench)[0, :3]) / np.linalg.norm(base.contact.wrench[0, :3])
    assert change <= 1.001 * fitted.correction.largest[1]


def test_positions_are_needed_to_learn(model) -> None:
    few = synthetic(model, 3, 1)
    with pytest.raises(InputError, match="two positions"):
        fit_pose(model, few)


def test_features_are_zero_at_rest_and_quadratic() -> None:
    assert not quadratic_features(np.zeros(3)).any()
    assert_allclose(quadratic_features(np.array([2.0, 3.0])), [2.0, 3.0, 4.0, 6.0, 9.0])


def test_bounds_grow_outside_of_what_was_learned_from(model) -> None:
    fitted = fit_pose(model, synthetic(model, 100, 1), n_modes=3)
    known = replace(fitted, domain=replace(fitted.domain, learned_low=(0.0, 0.0), learned_high=(40.0, 40.0)))
    inside = known.predict(TURN, tip()).trust
    beside = replace(known, domain=replace(known.domain, learned_low=(0.0, 32.0))).predict(TURN, tip()).trust
    assert beside.bound == pytest.approx(1.4 * inside.bound)  # 10 mm outside
    assert beside.force_bound == pytest.approx(1.4 * inside.force_bound)
    assert beside.expected == pytest.approx(1.4 * inside.expected)
    nearer = replace(known, domain=replace(known.domain, learned_low=(0.0, 22.001))).predict(TURN, tip()).trust
    assert nearer.bound == pytest.approx(inside.bound, rel=1e-3)


def test_files_keep_a_model_and_refuse_a_damaged_one(model, tmp_path) -> None:
    fitted = fit_pose(model, synthetic(model, 100, 1), n_modes=3)
    save_pose_model(fitted, tmp_path)
    loaded = load_pose_model(tmp_path, fitted.hybrid)
    before, after = (m.predict(TURN, tip()) for m in (fitted, loaded))
    assert_allclose(after.trust.force_bound, before.trust.force_bound, rtol=1e-9)
    assert_allclose(after.trust.bound, before.trust.bound, rtol=1e-9)
    assert before.trust.bound > before.trust.expected > 0.0
    assert before.trust.force_bound > 0.0
    assert_array_equal(before.displacement, after.displacement)
    assert_array_equal(before.wrench, after.wrench)
    path = tmp_path / POSE_FILE
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(InputError):
        load_pose_model(tmp_path, fitted.hybrid)
    with pytest.raises(InputError):
        load_pose_model(tmp_path / "absent", fitted.hybrid)


NAN = float("nan")


@pytest.mark.parametrize(("change", "named"), [
    (lambda arrays, about: about.update(steps=10**9), "steps"),
    (lambda arrays, about: about.pop("domain"), "domain"),
    (lambda arrays, about: about["domain"].update(deepest=NAN), "finite"),
    (lambda arrays, about: about["contact"].update(gap="2"), "gap"),
    (lambda arrays, about: about.update(spacings=[0.0, 0.75]), "spacings"),
    (lambda arrays, about: about.update(spacings=[0.75] * 3), "complete pose model"),
    (lambda arrays, about: about.update(mesh_hash="another"), "a pose model of linear"),
    (lambda arrays, about: arrays.update({"probe1.origin": np.zeros(2)}), "origin"),
    (lambda arrays, about: arrays.update({"probe0.coefficients": np.full((4, 4, 4), NAN)}), "coefficients"),
    (lambda arrays, about: arrays["probe0.triangles"].__setitem__((0, 0), 10**6), "triangles"),
    (lambda arrays, about: about.update(corrected=True), "correction"),
])
def test_a_damaged_setting_or_array_is_refused(model, tmp_path, change, named) -> None:
    save_pose_model(model, tmp_path)
    arrays, about = read_arrays(tmp_path / POSE_FILE)
    arrays = {name: np.array(array) for name, array in arrays.items()}
    change(arrays, about)
    write_arrays(tmp_path / POSE_FILE, arrays, about=about)
    BUNDLE.seal(tmp_path, [POSE_FILE])
    with pytest.raises(InputError, match=named) as caught:
        load_pose_model(tmp_path, model.hybrid)
    assert POSE_FILE in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bundle_of_paths_in_other_steps_says_so(model, tmp_path) -> None:
    assert not any("in steps of" in reason for reason in model.predict(TURN, tip(depth=2.5)).trust.reasons)
    save_pose_model(model, tmp_path)
    arrays, about = read_arrays(tmp_path / POSE_FILE)
    assert about["contact"]["step"] == 1.0
    about["contact"]["step"] = 2.0
    write_arrays(tmp_path / POSE_FILE, arrays, about=about)
    BUNDLE.seal(tmp_path, [POSE_FILE])
    coarse = load_pose_model(tmp_path, model.hybrid)
    reasons = coarse.predict(TURN, tip(depth=2.5)).trust.reasons
    assert any("in steps of 2 mm instead of 1 mm" in reason for reason in reasons)


def test_a_shift_of_the_skin_never_exceeds_a_part_of_the_linear_answer(model) -> None:
    base = model.predict(TURN, tip(depth=25.0))
    assert np.isfinite(base.displacement).all()
    assert np.abs(base.displacement).max() < 60.0
    assert not base.trust.sound
    assert any("beyond first touch" in reason for reason in base.trust.reasons)


def test_the_part_of_the_newton_step_is_that_with_which_forces_fit(model) -> None:
    poses = np.concatenate([tip(14.0 + 2.0 * i, 18.0 + i) for i in range(6)])
    wrench = []
    for place in poses:
        linear, bent = (
            replace(model, steps=steps).uncorrected(TURN, place[None]).contact.wrench[0] for steps in (0, 1)
        )
        wrench.append(0.7 * linear + 0.3 * bent)
    table = replace(
        pressed_table(model.hybrid.mesh, 6), probe_rotation=np.repeat(TURN, 6, axis=0), probe_translation=poses,
        probe_wrench=np.array(wrench),
    )
    assert fitted_bend(model, table).bend == pytest.approx(0.3, abs=1e-6)


def test_errors_to_expect_are_those_of_a_choice_made_elsewhere() -> None:
    fold = np.array([0, 0, 1, 1])
    # The first candidate serves best in the first fold, the second in the other one.
    of_each = np.array([[0.0, 0.0, 5.0, 5.0], [2.0, 2.0, 1.0, 1.0]])
    errors = np.stack([of_each, of_each], axis=1)
    left = [np.full((4, 7), 1.0), np.full((4, 7), 2.0)]
    found = _blind(errors, left, fold)
    assert_array_equal(found[:, 0], [2.0, 2.0, 1.0, 1.0])
    assert_array_equal(found[:, -1], [2.0, 2.0, 1.0, 1.0])
