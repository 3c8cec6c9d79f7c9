import numpy as np
import pytest

from fem.block_mesh import block
from mixpinn.fem.material.hyperelastic import LinearElastic, StableNeoHookean, StableNeoHookeanLog
from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics import linear_tetrahedron as kernels
from mixpinn.physics.energies import LOCAL_PAIRS, STABLE, STABLE_LOG

MATERIALS = [StableNeoHookean(mu=1.0, lam=2.0), StableNeoHookeanLog(mu=1.0, lam=2.0), LinearElastic(mu=1.0, lam=2.0)]


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_compiled_kernels_agree_with_the_formulas(material):
    mesh = block((2, 2, 2), shake=0.2)
    cells = np.sort(mesh.cells.astype(np.int64), axis=1)
    moved = 0.15 * np.random.default_rng(1).normal(size=mesh.points.shape)
    gradients, volumes = shape_gradients(mesh.points, cells)
    code = {StableNeoHookean: 0, StableNeoHookeanLog: 1, LinearElastic: 2}[type(material)]
    m = len(cells)
    inputs = (
        cells, moved, gradients, volumes, np.full(m, code), np.full(m, material.mu), np.full(m, material.lam),
    )
    f = np.empty((m, 3, 3))
    kernels.cell_deformations(0, m, cells, moved, gradients, f)
    np.testing.assert_allclose(f, np.eye(3) + np.einsum("mai,maj->mij", moved[cells], gradients), atol=1e-12)

    energies, forces, blocks = np.empty(m), np.empty((m, 4, 3)), np.empty((m, 6, 3, 3))
    kernels.cell_energies(0, m, *inputs, energies)
    np.testing.assert_allclose(energies, volumes * material.energy(f), rtol=1e-10, atol=1e-14)
    kernels.cell_forces(0, m, *inputs, forces)
    expected = np.einsum("m,mij,maj->mai", volumes, material.gradient(f), gradients)
    np.testing.assert_allclose(forces, expected, atol=1e-12 * np.abs(expected).max())
    kernels.cell_blocks(0, m, *inputs, False, blocks)
    tangent = material.hessian(f).reshape(-1, 3, 3, 3, 3)
    full = np.einsum("m,maj,mijkl,mbl->mabik", volumes, gradients, tangent, gradients)
    for pair, (a, b) in enumerate(LOCAL_PAIRS):
        np.testing.assert_allclose(blocks[:, pair], full[:, a, b], atol=1e-12 * np.abs(full).max())


@pytest.mark.parametrize("kind", [STABLE, STABLE_LOG])
def test_tiny_strains_keep_their_digits(kind):
    # A strain of 1e-9: the energy is μ ε : ε + λ/2 (tr ε)², 18 digits below the moduli.
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    strain = 1e-9 * np.array([[1.0, 0.3, 0.0], [0.3, -0.5, 0.2], [0.0, 0.2, 0.1]])
    cells, out = np.array([[0, 1, 2, 3]]), np.empty(1)
    gradients, volumes = shape_gradients(points, cells)
    one = np.ones(1)
    kernels.cell_energies(0, 1, cells, points @ strain, gradients, volumes, np.array([kind]), one, one, out)
    expected = ((strain**2).sum() + 0.5 * np.trace(strain) ** 2) / 6.0
    assert out[0] == pytest.approx(expected, rel=1e-8, abs=0.0)
