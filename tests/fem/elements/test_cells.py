import numpy as np
import pytest

from fem.block_mesh import block
from mixpinn.fem.elements.cells import ElasticCells
from mixpinn.fem.elements.ranges import RangeRunner
from mixpinn.fem.material.hyperelastic import LinearElastic, StableNeoHookean


def test_each_cell_takes_the_material_of_its_tissue():
    mesh = block((2, 2, 2))
    cells = np.sort(mesh.cells.astype(np.int64), axis=1)
    left = mesh.points[cells].mean(axis=1)[:, 0] < 0.5
    soft, stiff = StableNeoHookean(mu=1.0, lam=2.0), LinearElastic(mu=5.0, lam=3.0)
    elastic = ElasticCells(mesh.points, cells, np.where(left, 0, 1), [soft, stiff], RangeRunner())
    deformation = np.array([[[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.3]]])
    expected = 0.5 * soft.energy(deformation)[0] + 0.5 * stiff.energy(deformation)[0]
    assert elastic.energy(mesh.points @ deformation[0].T) == pytest.approx(expected, rel=1e-12)
