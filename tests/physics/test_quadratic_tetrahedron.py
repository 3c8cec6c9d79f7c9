import numpy as np
import pytest

from fem.block_mesh import block
from mixpinn.fem.material.hyperelastic import LinearElastic, StableNeoHookean, StableNeoHookeanLog
from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics import quadratic_tetrahedron as kernels
from mixpinn.physics.energies import LOCAL_PAIRS
from mixpinn.physics.given_stress import quadratic_blocks_of_tangent, quadratic_forces_of_stress
from mixpinn.physics.quadrature import TETRAHEDRON_4, TETRAHEDRON_14

MATERIALS = [StableNeoHookean(mu=1.0, lam=2.0), StableNeoHookeanLog(mu=1.0, lam=2.0), LinearElastic(mu=1.0, lam=2.0)]


def shape_functions(places, gradients):
    """Gradients of the ten shape functions, from their definition: (m, p, 10, 3)."""
    at_vertex = np.einsum("qa,mai->mqai", 4.0 * places - 1.0, gradients)
    first, second = LOCAL_PAIRS.T
    at_middle = 4.0 * (
        np.einsum("qe,mei->mqei", places[:, first], gradients[:, second])
        + np.einsum("qe,mei->mqei", places[:, second], gradients[:, first])
    )
    return np.concatenate([at_vertex, at_middle], axis=2)


def case(material):
    mesh = block((2, 2, 1), shake=0.2).with_order(2)
    cells = np.sort(mesh.cell_nodes, axis=1)
    moved = 0.1 * np.random.default_rng(1).normal(size=mesh.node_points.shape)
    gradients, volumes = shape_gradients(mesh.node_points, cells[:, :4])
    code, m = {StableNeoHookean: 0, StableNeoHookeanLog: 1, LinearElastic: 2}[type(material)], len(cells)
    constants = (np.full(m, code), np.full(m, material.mu), np.full(m, material.lam))
    return cells, moved, gradients, volumes, constants


@pytest.mark.parametrize("rule", [TETRAHEDRON_4, TETRAHEDRON_14], ids=repr)
@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_kernels_agree_with_the_definition(material, rule):
    cells, moved, gradients, volumes, constants = case(material)
    m, p = len(cells), len(rule)
    by_shape = shape_functions(rule.points, gradients)
    f = np.empty((m, p, 3, 3))
    kernels.cell_deformations(0, m, cells, moved, gradients, rule.points, f)
    np.testing.assert_allclose(f, np.eye(3) + np.einsum("mni,mqnj->mqij", moved[cells], by_shape), atol=1e-12)
    determinants = np.empty((m, p))
    kernels.cell_jacobians(0, m, cells, moved, gradients, rule.points, determinants)
    np.testing.assert_allclose(determinants, np.linalg.det(f), atol=1e-12)

    inputs = (cells, moved, gradients, volumes, rule.points, rule.weights, *constants)
    flat, weights = f.reshape(-1, 3, 3), volumes[:, None] * rule.weights
    energies, forces, blocks = np.empty(m), np.empty((m, 10, 3)), np.empty((m, 45, 3, 3))
    kernels.cell_energies(0, m, *inputs, energies)
    np.testing.assert_allclose(energies, (weights * material.energy(flat).reshape(m, p)).sum(axis=1), rtol=1e-10)
    stress = material.gradient(flat).reshape(m, p, 3, 3)
    expected = np.einsum("mq,mqij,mqnj->mni", weights, stress, by_shape)
    kernels.cell_forces(0, m, *inputs, forces)
    np.testing.assert_allclose(forces, expected, atol=1e-12 * np.abs(expected).max())
    tangent = material.hessian(flat).reshape(m, p, 9, 9)
    full = np.einsum(
        "mq,mqaj,mqijkl,mqbl->mabik", weights, by_shape, tangent.reshape(m, p, 3, 3, 3, 3), by_shape, optimize=True,
    )
    expected = np.stack([full[:, a, b] for a, b in kernels.NODE_PAIRS], axis=1)
    kernels.cell_blocks(0, m, *inputs, False, blocks)
    np.testing.assert_allclose(blocks, expected, atol=1e-12 * np.abs(expected).max())

    given = np.empty_like(forces)
    quadratic_forces_of_stress(0, m, stress, gradients, volumes, rule.points, rule.weights, given)
    np.testing.assert_allclose(given, forces, atol=1e-12 * np.abs(forces).max())
    given = np.empty_like(blocks)
    quadratic_blocks_of_tangent(0, m, tangent, gradients, volumes, rule.points, rule.weights, given)
    np.testing.assert_allclose(given, blocks, atol=1e-12 * np.abs(expected).max())


def test_projected_blocks_are_those_of_the_projected_tangents():
    material = MATERIALS[0]
    cells, moved, gradients, volumes, constants = case(material)
    rule, m = TETRAHEDRON_4, len(cells)
    f, blocks = np.empty((m, 4, 3, 3)), np.empty((m, 45, 3, 3))
    kernels.cell_deformations(0, m, cells, 3.0 * moved, gradients, rule.points, f)
    values, vectors = np.linalg.eigh(material.hessian(f.reshape(-1, 3, 3)))
    assert values.min() < 0.0
    tangent = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    expected = np.empty_like(blocks)
    quadratic_blocks_of_tangent(
        0, m, tangent.reshape(m, 4, 9, 9), gradients, volumes, rule.points, rule.weights, expected,
    )
    inputs = (cells, 3.0 * moved, gradients, volumes, rule.points, rule.weights, *constants)
    kernels.cell_blocks(0, m, *inputs, True, blocks)
    np.testing.assert_allclose(blocks, expected, atol=1e-9 * np.abs(expected).max())
