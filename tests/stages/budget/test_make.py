"""The error budget of a toy bundle: what is known of its entries, and that it goes on where it was stopped."""

from dataclasses import replace

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.records.error_budget import BUDGET_FILE, BudgetKind, ErrorBudget
from mixpinn.stages.budget.entries import PREDICTOR, entry_of
from mixpinn.stages.budget.make import PAGE_FILE, make_budget
from mixpinn.stages.budget.solves import Found, presses
from mixpinn.stages.budget.variants import (
    CELLS,
    FIXED,
    FRICTION,
    GAP,
    MODULUS,
    PENALTY,
    POISSON,
    BudgetConfig,
    Finer,
    base_scene,
    variants,
)
from serving.live.pressed import block_predictor, save_bundle

CONFIG = BudgetConfig(poses=1, depth=1.0, finer=Finer.QUADRATIC)


@pytest.fixture(scope="module")
def predictor():
    return block_predictor()


@pytest.fixture(scope="module")
def bundle(predictor, tmp_path_factory):
    return save_bundle(predictor, tmp_path_factory.mktemp("bundle"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("budget") / "run"


@pytest.fixture(scope="module")
def budget(bundle, folder):
    return make_budget(bundle, CONFIG, out=folder)


def test_every_source_has_an_entry_with_a_sentence(budget, folder):
    found = {entry.source: entry for entry in budget.entries}
    assert found.keys() >= {PREDICTOR, PENALTY, GAP, CELLS, FRICTION, POISSON, MODULUS}
    for entry in budget.entries:
        assert entry.solved == 1, entry.source
        assert entry.sentence.endswith(".")
        assert entry.motions.keys() == {"L1", "L2"}
    assert budget.complete
    page = (folder / PAGE_FILE).read_text()
    assert budget.sentence in page
    assert all(source in page for source in found)


def test_the_total_is_the_root_of_the_sum_of_the_squares_of_the_errors(budget):
    errors = [entry for entry in budget.entries if entry.kind is BudgetKind.ERROR]
    assert budget.total_force == pytest.approx(np.linalg.norm([entry.force for entry in errors]))
    assert budget.total_motions["L1"] == pytest.approx(np.linalg.norm([entry.motions["L1"] for entry in errors]))


def test_finer_cells_are_softer(budget):
    """Displacement elements are stiffer than what they approximate: at a given depth the force falls."""
    cells = next(entry for entry in budget.entries if entry.source == CELLS)
    assert cells.force_share < -0.05
    assert cells.field > 0.0


def test_a_single_tissue_scales_forces_and_leaves_motions(predictor, bundle, budget, tmp_path):
    """The closed form of the modulus entry, against a solve."""
    from mixpinn.fem.solve.pose import solve_pose

    base = base_scene(predictor, CONFIG)
    press = presses(predictor.mesh, np.eye(3), 1)[0]
    tip = press.tip(base, 1.0)
    stiff = replace(
        base, contact=replace(base.contact, stiffness=1.2 * base.contact.stiffness),
        materials=tuple(type(m)(1.2 * m.mu, 1.2 * m.lam) for m in base.materials),
    )
    one, other = (Found.of(solve_pose(scene, tip, np.eye(3)), predictor.mesh) for scene in (base, stiff))
    np.testing.assert_allclose(other.force, 1.2 * one.force, rtol=1e-3)
    np.testing.assert_allclose(other.translations, one.translations, atol=1e-4)
    modulus = next(entry for entry in budget.entries if entry.source == MODULUS)
    assert modulus.force == pytest.approx(0.2 * np.linalg.norm(one.force), rel=1e-6)
    assert not any(modulus.motions.values())


def test_it_goes_on_from_what_was_solved_and_comes_to_the_same(bundle, budget, folder, tmp_path, monkeypatch):
    import mixpinn.stages.budget.solves as solves

    kept = sorted((folder / "solves").iterdir())
    kept[0].unlink()
    asked = []
    solve = solves.solve_pose
    monkeypatch.setattr(solves, "solve_pose", lambda *a, **k: asked.append(1) or solve(*a, **k))
    again = make_budget(bundle, CONFIG, out=folder)
    assert len(asked) == 1
    assert again.total_force == pytest.approx(budget.total_force, rel=1e-4)
    assert ErrorBudget.load(folder / BUDGET_FILE) == again


def test_stopped_early_it_says_what_is_missing(bundle, tmp_path):
    with pytest.raises(InputError, match="--minutes"):
        make_budget(bundle, CONFIG, out=tmp_path / "run", minutes=0.0)


def test_a_damaged_solve_is_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"no solve")
    with pytest.raises(InputError, match="kept solve"):
        Found.load(tmp_path / "a.npz")
    sound = {
        "force": np.ones(3), "translations": np.ones((2, 3)), "field": np.ones((4, 3)), "converged": np.array(True),
    }
    for name, wrong, says in (
        ("force", np.array([1.0, np.nan, 1.0]), "finite"), ("translations", np.ones(6), "shape"),
        ("field", np.ones((4, 2)), "shape"), ("converged", np.array([True]), "shape"),
    ):
        np.savez(tmp_path / "a.npz", **(sound | {name: wrong}))
        with pytest.raises(InputError, match=f"{name}: .*{says}"):
            Found.load(tmp_path / "a.npz")


def test_the_fixed_region_grows_and_shrinks_on_the_skin(predictor):
    base = base_scene(predictor, CONFIG)
    changed = [v.scene().mesh for v in variants(base, BudgetConfig(fixed=11.0)) if v.source == FIXED]
    assert len(changed) == 1  # the block is held at its bottom: a smaller region holds nothing
    more = changed[0].fixed & ~base.mesh.fixed
    assert more.any()
    assert (base.mesh.points[more, 1] <= 11.0).all()
    assert (base.mesh.part[more] == 0).all()


def test_poissons_ratio_changes_at_the_same_youngs_modulus(predictor):
    base = base_scene(predictor, CONFIG)
    for variant, ratio in zip(
        [v for v in variants(base, CONFIG) if v.source == POISSON], (0.42, 0.48), strict=True,
    ):
        material = variant.scene().materials[0]
        young = material.mu * (3 * material.lam + 2 * material.mu) / (material.lam + material.mu)
        assert young == pytest.approx(25.4e-3)
        assert material.lam / (2 * (material.lam + material.mu)) == pytest.approx(ratio)
        assert variant.value == f"{ratio:.3f}"


def test_presses_lie_over_the_rigid_parts(predictor):
    bones = predictor.mesh.points[predictor.mesh.part > 0]
    for press in presses(predictor.mesh, np.eye(3), 4):
        assert (press.place[[0, 2]] >= bones.min(axis=0)[[0, 2]]).all()
        assert (press.place[[0, 2]] <= bones.max(axis=0)[[0, 2]]).all()


def test_the_larger_of_two_ends_counts(predictor):
    mesh, still = predictor.mesh, np.zeros((2, 3))
    base = {0: Found(np.array([0.0, 10.0, 0.0]), still, np.zeros((1, 3)), True)}
    ends = [
        {0: Found(np.array([0.0, 11.0, 0.0]), still + np.array([0.1, 0.0, 0.0]), np.zeros((1, 3)), True)},
        {0: Found(np.array([0.0, 8.0, 0.0]), still, np.full((1, 3), 1.0), True)},
    ]
    entry = entry_of(FRICTION, BudgetKind.SENSITIVITY, "1 → 0.5, 1.5", base, ends, mesh, planned=2)
    assert (entry.force, entry.force_share) == pytest.approx((2.0, 0.2))
    assert entry.motions == pytest.approx({"L1": 0.1, "L2": 0.1})
    assert entry.field == pytest.approx(np.sqrt(3.0))
    assert entry.motion_share > 1e6  # nothing moved before
    assert "1 of 2" in entry.note


def test_changes_are_extrapolated_in_proportion(predictor):
    base = Found(np.array([0.0, 10.0, 0.0]), np.zeros((2, 3)), np.zeros((1, 3)), True)
    other = Found(np.array([0.0, 9.0, 0.0]), np.full((2, 3), 0.1), np.full((1, 3), 0.2), True)
    more = other.extrapolated(base, 4.0)
    np.testing.assert_allclose(more.force, [0.0, 6.0, 0.0])
    np.testing.assert_allclose(more.translations, 0.4)
    np.testing.assert_allclose(more.field, 0.8)
    scales = {v.source: v.scale for v in variants(base_scene(predictor, CONFIG), CONFIG)}
    assert (scales[PENALTY], scales[GAP], scales[FRICTION]) == pytest.approx((4.0 / 3.0, 4.0, 1.0))


@pytest.mark.parametrize("change", [{"poses": 0}, {"depth": -1.0}, {"modulus": 1.0}, {"fixed": 0.0}])
def test_settings_are_checked(change):
    with pytest.raises(InputError, match=f"budget.{next(iter(change))}"):
        BudgetConfig(**change)
