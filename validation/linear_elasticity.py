"""Linear elasticity against scikit-fem, the order of convergence, and Newton's."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import ElasticSystem, LinearElastic, StableNeoHookean, default_solver
from mixpinn.physics.quadrature import TETRAHEDRON_4, TETRAHEDRON_14
from mixpinn.records.tissue_mesh import CELL_EDGES
from validation.blocks import block, labelled, surface_nodes, two_bones
from validation.newton import equilibrium
from validation.result import Result, Section, picture
from validation.scikit_oracle import oracle_difference

AMPLITUDE = np.array([1.0, -0.5, 0.7])


def body_force(x: FloatArray, material: LinearElastic) -> FloatArray:
    """−div σ = −μ Δu − (λ + μ) ∇ div u of the manufactured u = a Π sin(π x_i), shape (..., 3)."""
    s, c = np.sin(np.pi * x), np.cos(np.pi * x)
    product = s.prod(axis=-1)
    second = np.empty((*x.shape, 3))
    for i in range(3):
        for j in range(3):
            k = 3 - i - j
            second[..., i, j] = -(np.pi**2) * product if i == j else np.pi**2 * c[..., i] * c[..., j] * s[..., k]
    return 3.0 * np.pi**2 * material.mu * product[..., None] * AMPLITUDE - (
        material.lam + material.mu
    ) * (second @ AMPLITUDE)


def manufactured_error(n: int, *, order: int = 1, tolerance: float = 1e-10, mirrored: bool = True) -> float:
    """L2 norm of the displacement's error on a cube of n³ cells of an order, for u = a Π sin(π xᵢ)."""
    material, rule = LinearElastic(mu=1.0, lam=1.5), TETRAHEDRON_4 if order == 1 else TETRAHEDRON_14
    mesh = block((n, n, n), mirrored=mirrored)
    mesh = labelled(mesh.points, mesh.cells, fixed=surface_nodes(mesh)).with_order(order)
    system = ElasticSystem(mesh, [material])
    at = shape = rule.points
    if order == 2:
        shape = np.concatenate([at * (2.0 * at - 1.0), 4.0 * at[:, CELL_EDGES].prod(axis=2)], axis=1)
    places = np.einsum("qa,mai->mqi", at, mesh.points[mesh.cells])
    share = mesh.cell_volumes[:, None] * rule.weights
    load = np.zeros_like(mesh.node_points)
    np.add.at(load, mesh.cell_nodes, np.einsum("mqi,qn,mq->mni", body_force(places, material), shape, share))
    found = equilibrium(system, system.rest_state(), load=load, tolerance=tolerance, linear=default_solver(1))
    if not found.converged:
        return float("nan")
    moved = np.einsum("qn,mni->mqi", shape, (found.state.points - mesh.node_points)[mesh.cell_nodes])
    error = moved - AMPLITUDE * np.sin(np.pi * places).prod(axis=-1)[..., None]
    return float(np.sqrt(np.einsum("mqi,mqi,mq->", error, error, share)))


def order_of_convergence(sizes: Sequence[int], errors: Sequence[float] | FloatArray) -> float:
    """Exponent of the error in the mesh width, from the two finest meshes: the coarsest is not yet asymptotic."""
    return float(np.log(errors[-2] / errors[-1]) / np.log(sizes[-1] / sizes[-2]))


def newton_history() -> list[float]:
    """Residuals of Newton's method on a loaded block with two rigid parts, at finite strain."""
    mesh = two_bones()
    system = ElasticSystem(mesh, [StableNeoHookean(mu=1.0, lam=4.0)])
    load = np.zeros_like(mesh.points)
    load[mesh.points[:, 1] > 30.0 - 1e-9] = [1.5, -3.0, -1.0]
    load[mesh.part == 2] = [0.0, -1.0, 2.0]
    return equilibrium(system, system.rest_state(), load=load, tolerance=1e-10).history


def newton_orders(history: list[float]) -> FloatArray:
    """Exponents p of e_{k+1} = C e_k^p, from three consecutive residuals above rounding each."""
    above = np.log([value for value in history if value > 1e-11 * history[0]])
    return np.diff(above)[1:] / np.diff(above)[:-1]


def run(folder: Path) -> Section:
    """The checks."""
    difference = oracle_difference((8, 5, 5), order=1)
    results = [Result.at_most("linear elasticity against scikit-fem, relative difference", difference, 1e-8)]
    sizes = np.array([4, 8, 12, 16, 24])
    errors = np.array([manufactured_error(int(n)) for n in sizes])
    order = order_of_convergence(sizes, errors)
    results.append(Result.within("order of convergence in L2, manufactured solution", order, 1.8, 2.2))
    history = newton_history()
    orders = newton_orders(history)
    results.append(Result("order of Newton's last step", float(orders[-1]), "≥ 1.9", bool(orders[-1] >= 1.9)))

    def draw(axes):  # type: ignore[no-untyped-def]
        axes.loglog(1.0 / sizes, errors, "o-", label="error in L2")
        axes.loglog(1.0 / sizes, errors[-1] * (sizes[-1] / sizes) ** 2, "k--", linewidth=0.8, label="order 2")
        axes.set(xlabel="mesh width h", ylabel="error of the displacement")
        axes.legend(frameon=False, fontsize=8)

    text = ", ".join(f"{value:.1e}" for value in history)
    return Section(
        "Linear elasticity and orders of convergence",
        "A clamped block under random nodal forces is solved by scikit-fem on the same mesh. The order is taken from "
        "the two finest meshes for a manufactured solution a Π sin(π xᵢ) on the unit cube. Newton's method on a "
        f"block with two rigid parts at finite strain leaves the residuals {text} N.",
        tuple(results), picture(folder, "convergence", draw),
    )
