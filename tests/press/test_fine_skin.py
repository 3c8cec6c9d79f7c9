"""Forces on finer skin: the minimum that they are, what their compliance is, and that they are kept with a model."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from mixpinn.base.errors import InputError
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.fem import LocalRefinement, SuperLUSolver
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.files import load_pose_model, save_pose_model
from mixpinn.press.fine_skin import FineContact, FineSkin, own_along
from mixpinn.press.force_law import TERMS, ForceLaw
from mixpinn.press.grip import SIGNS
from mixpinn.press.model import PoseModel
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import BUNDLE, POSE_FILE, HybridModel
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.stages.fine_skin import build_fine_skin
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh

UPRIGHT = np.eye(3)


@pytest.fixture(scope="module")
def prior():
    mesh = block_mesh().with_order(2)
    return ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())


@pytest.fixture(scope="module")
def skin(prior):
    return build_fine_skin(prior, [TISSUE], LocalRefinement(8.0, 1.0, extrapolated=False))


@pytest.fixture(scope="module")
def model(prior, skin):
    size, rows = prior.coordinates.size, 3 * len(prior.nodes)
    nothing = Rows.of(np.zeros((0, size)))
    newton = ModalNewton(
        prior, Equilibrium.of_materials(prior.mesh, [TISSUE]), nothing, nothing, np.zeros((0, rows), np.float32),
    )
    readers = np.random.default_rng(0).normal(size=(4, rows)).astype(np.float32)
    hybrid = HybridModel(newton, readers, np.zeros((14, 0), np.float32))
    contact = PriorContact.of_prior(prior)
    along, across = np.zeros(SIGNS), np.zeros((2, TERMS))
    along[0], across[:, 0] = 0.1, 1.0
    law = ForceLaw(along, np.array([1.0]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), across)
    return PoseModel(
        hybrid, contact, (contact.field(tool()),), PoseDomain.of_mesh(prior.mesh), steps=0, law=law,
        fine=FineContact.of_prior(skin, prior, stiffness=contact.config.stiffness),
    )


def tool():
    return linear_probe(length=22.0, width=14.0, height=20.0, radius=3.0)


def tip(x=18.0, z=21.0, depth=3.0):
    return np.array([x, 42.0 - depth, z])  # contact acts at a distance of 2 mm from skin at 40 mm


def dense(skin, own):
    """P W Pᵀ + L as a whole, (n, n)."""
    n = len(skin.places)
    shape = np.zeros((n, len(own)))
    np.add.at(shape, (np.arange(n)[:, None], skin.stencil), skin.weights)
    found = shape @ own @ shape.T
    first = np.repeat(np.arange(n), np.diff(skin.starts))
    found[first, skin.others] += skin.more
    return found


def test_the_skin_yields_as_that_of_a_finer_mesh_does(prior, skin) -> None:
    from mixpinn.fem.local_refinement import refine_skin

    fine = refine_skin(prior.mesh, prior.mesh.skin_faces[
        np.isin(prior.mesh.skin_node_faces, prior.nodes).all(axis=1)
    ], LocalRefinement(8.0, 1.0, extrapolated=False))
    node = cKDTree(fine.node_points).query(skin.places)[1]
    assert len(np.unique(node)) > 2 * len(prior.nodes)
    order = np.argsort(node)
    whole = ElasticPrior.build(fine, [TISSUE], nodes=node[order], linear=SuperLUSolver())
    found = dense(skin, own_along(prior).astype(np.float64))[np.ix_(order, order)]
    places = skin.places[order]
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    expected = np.asarray(whole.own_compliance[1::3, 1::3], dtype=np.float64)
    near = apart <= 19.9
    assert_allclose(found[near], expected[near], atol=1e-5 * expected.max())
    # Farther nodes yield as the own mesh has it: within a hundredth of what a node yields under its own force.
    assert np.abs(found - expected)[~near].max() < 1e-2 * expected.max()
    # Finer cells yield more, at every node.
    coarse = dense(replace(skin, more=np.zeros_like(skin.more)), own_along(prior).astype(np.float64))
    assert (np.diag(coarse) < np.diag(found)[np.argsort(order)]).all()


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.0, 0.4, 0.12])])
@pytest.mark.parametrize("depth", [0.4, 3.0, 6.0])
def test_forces_are_those_of_least_energy(prior, skin, model, turn, depth) -> None:
    own = own_along(prior).astype(np.float64)
    contact, field = model.fine, model.probes[0]
    rotation, place = rotation_from_vector(turn), tip(depth=depth)
    found = contact.push([field], rotation[None], place[None])[0]
    # By non-negative least squares (C. L. Lawson and R. J. Hanson 1974): A = R Rᵀ, least |Rᵀ p − R⁻¹ δ|.
    local = (contact._places - place) @ rotation
    columns = (local[:, [0, 2]] - field.origin[[0, 2]]) / field.spacing
    i, j = np.floor(columns).astype(int).T
    inside = (i >= 0) & (j >= 0) & (i < field.underside.shape[0] - 1) & (j < field.underside.shape[1] - 1)
    a, b = (columns - np.floor(columns)).T
    i, j = np.where(inside, i, 0), np.where(inside, j, 0)
    under = field.underside
    with np.errstate(invalid="ignore"):
        low = (1 - a) * ((1 - b) * under[i, j] + b * under[i, j + 1])
        low += a * ((1 - b) * under[i + 1, j] + b * under[i + 1, j + 1])
    delta = np.where(inside & np.isfinite(low), local[:, 1] - low, -1.0)
    on = np.flatnonzero(delta > 0.0)
    shape = np.zeros((len(on), len(skin.places)))
    np.add.at(shape, (np.arange(len(on))[:, None], contact._points.stencil[on]), contact._points.weights[on])
    matrix = shape @ dense(skin, own) @ shape.T + np.diag(contact._soft[on])
    root = np.linalg.cholesky(matrix)
    expected = nnls(root.T, np.linalg.solve(root, delta[on]))[0].sum()
    assert found == pytest.approx(expected, rel=3e-3)
    assert expected > 0.0


def test_forces_grow_with_depth_without_jumps_and_begin_at_first_touch(model) -> None:
    depths = np.linspace(-0.5, 5.0, 56)
    push = np.array([
        model.fine.push(model.probes[:1], UPRIGHT[None], tip(depth=depth)[None])[0] for depth in depths
    ])
    assert (push[depths < 0.0] == 0.0).all()
    assert (np.diff(push[depths >= 0.0]) > 0.0).all()
    steps = np.diff(push[depths >= 0.1])  # flat on flat, the force begins with a slope
    assert np.abs(np.diff(steps)).max() < 0.15 * steps.max()


def test_two_probes_at_once_share_the_skin(model) -> None:
    one, other = tip(x=10.0, z=30.0), tip(x=28.0, z=10.0)
    fields, turns = (model.probes[0],) * 2, np.stack([UPRIGHT, UPRIGHT])
    both = model.fine.push(fields, turns, np.stack([one, other]))
    swapped = model.fine.push(fields, turns, np.stack([other, one]))
    alone = [model.fine.push(fields[:1], UPRIGHT[None], place[None])[0] for place in (one, other)]
    assert_allclose(both, swapped[::-1], rtol=2e-3)
    assert (both < alone).all()  # each finds skin that the other has pushed down
    assert (both > 0.5 * np.array(alone)).all()


def test_the_law_begins_with_the_force_on_finer_skin_and_is_kept_with_it(model, tmp_path) -> None:
    place = tip()
    first = model.predict(UPRIGHT[None], place[None])
    fine = model.fine.push(model.probes[:1], UPRIGHT[None], place[None])[0]
    assert first.wrench[0, 1] == pytest.approx(fine * np.exp(0.1), rel=1e-9)
    without = replace(model, fine=None).predict(UPRIGHT[None], place[None])
    assert without.wrench[0, 1] > 1.02 * first.wrench[0, 1]  # the own faces are stiffer under a probe's edge
    model.hybrid.mesh.save(tmp_path / "mesh.vtu")
    save_pose_model(model, tmp_path)
    again = load_pose_model(tmp_path, model.hybrid).predict(UPRIGHT[None], place[None])
    assert_array_equal(again.wrench, first.wrench)
    assert_array_equal(again.displacement, first.displacement)


@pytest.mark.parametrize(("name", "value", "told"), [
    ("stencil", 10_000, "at most"), ("others", 10_000_000, "at most"), ("faces", -1, "at least"),
    ("starts", 0, "begin one after the other"), ("more", np.nan, "finite"),
])
def test_a_damaged_skin_is_refused(model, tmp_path, name, value, told) -> None:
    model.hybrid.mesh.save(tmp_path / "mesh.vtu")
    save_pose_model(model, tmp_path)
    arrays, about = read_arrays(tmp_path / POSE_FILE)
    arrays = dict(arrays) | {f"fine.{name}": arrays[f"fine.{name}"].copy()}
    arrays[f"fine.{name}"].reshape(-1)[-1] = value
    write_arrays(tmp_path / POSE_FILE, arrays, about=about)
    BUNDLE.seal(tmp_path, [POSE_FILE])
    with pytest.raises(InputError, match=told):
        load_pose_model(tmp_path, model.hybrid)


def test_a_law_from_before_there_was_finer_skin_is_read_as_it_was(model, tmp_path) -> None:
    before = replace(model, fine=None)
    before.hybrid.mesh.save(tmp_path / "mesh.vtu")
    save_pose_model(before, tmp_path)
    arrays, about = read_arrays(tmp_path / POSE_FILE)
    arrays = dict(arrays) | {"law.along": arrays["law.along"][:-1]}
    write_arrays(tmp_path / POSE_FILE, arrays, about=json.loads(json.dumps(about)) | {"format": 3})
    BUNDLE.seal(tmp_path, [POSE_FILE])
    place = tip()
    found, expected = (
        each.predict(UPRIGHT[None], place[None]).wrench for each in (load_pose_model(tmp_path, model.hybrid), before)
    )
    assert_array_equal(found, expected)


def test_skin_is_kept_as_it_is(skin) -> None:
    again = FineSkin.of_arrays(skin.arrays(), candidates=10_000, where="skin", remake="")
    for name, value in vars(skin).items():
        assert_array_equal(getattr(again, name), value, err_msg=name)
