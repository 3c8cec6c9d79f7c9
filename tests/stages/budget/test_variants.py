"""Variants of a scene on another mesh: the tissues of its cells have the scene's materials."""

from dataclasses import replace

import numpy as np
import pytest

from fem.block_mesh import two_bones
from mixpinn.anatomy.mixture import mixture_name
from mixpinn.base.errors import InputError
from mixpinn.fem import LocalRefinement, Scene, StableNeoHookean
from mixpinn.serving import HybridPredictor
from mixpinn.stages.budget.variants import CELLS, FACETS, BudgetConfig, Finer, base_scene, present, variants
from mixpinn.stages.hybrid import taught_with
from serving.live.pressed import block_predictor


def test_facets_whose_cells_hold_other_mixtures_of_the_same_tissues() -> None:
    fat, muscle = (StableNeoHookean.from_young(young, 0.45) for young in (0.02, 0.06))
    mesh = replace(two_bones(), tissue_names=("fat", "muscle", mixture_name("fat", "muscle", 0.6)))
    base = Scene(mesh, materials=(fat, muscle, StableNeoHookean.from_young(0.03, 0.45)))
    facets = replace(mesh, tissue_names=("muscle", "fat", mixture_name("muscle", "fat", 0.9)))
    found = {variant.source: variant for variant in variants(base, BudgetConfig(sensitivity=False), facets=facets)}
    scene = found[FACETS].scene()
    assert scene.materials[:2] == (muscle, fat)
    assert scene.materials[2].mu == pytest.approx(0.9 * muscle.mu + 0.1 * fat.mu)
    other = replace(mesh, tissue_names=("fat", "muscle", "liver"), tissue=np.zeros_like(mesh.tissue))
    with pytest.raises(InputError, match="same label maps"):
        variants(base, BudgetConfig(sensitivity=False), facets=other)


def cells_of(base: Scene, finer: Finer = Finer.REFINED) -> Scene:
    config = BudgetConfig(sensitivity=False, finer=finer)
    return next(variant for variant in variants(base, config) if variant.source == CELLS).scene()


def test_cells_are_held_against_quadratic_ones_refined_under_the_probe() -> None:
    base = Scene(two_bones())
    found = cells_of(base)
    assert found.mesh.order == 2
    assert found.refinement == LocalRefinement().of_tool(base.probe)
    assert cells_of(base, Finer.QUADRATIC).refinement is None
    # What was simulated on refined cells is held against finer ones.
    own = replace(base, mesh=base.mesh.with_order(2), refinement=LocalRefinement(8.0))
    finer = cells_of(own).refinement
    assert finer is not None
    assert (finer.edge, finer.growth) == pytest.approx((8.0 / np.sqrt(2.0), 0.5 / np.sqrt(2.0)))
    assert "16 and 8 mm" in present(CELLS, own)


def test_a_bundle_is_solved_as_its_simulations_were(tmp_path) -> None:
    predictor = block_predictor()
    assert base_scene(predictor, BudgetConfig()).refinement is None
    refinement = LocalRefinement(9.0, 1.5, extrapolated=False)
    taught = taught_with(predictor.model, refinement)
    assert taught_with(predictor.model, None) is predictor.model
    taught.save(tmp_path)
    again = type(taught).load(tmp_path, taught.mesh)
    assert again.made_on == taught.made_on
    assert "edges of 9 mm growing by 1.5 mm a mm, under the probe" in again.made_on
    predictor = HybridPredictor(again, pose=predictor.pose)
    assert base_scene(predictor, BudgetConfig()).refinement == refinement
