"""Variants of a scene on another mesh: the tissues of its cells have the scene's materials."""

from dataclasses import replace

import numpy as np
import pytest

from fem.block_mesh import two_bones
from mixpinn.anatomy.mixture import mixture_name
from mixpinn.base.errors import InputError
from mixpinn.fem import Scene, StableNeoHookean
from mixpinn.stages.budget.variants import FACETS, BudgetConfig, variants


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
