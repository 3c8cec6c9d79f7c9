"""Linear elasticity against scikit-fem, the order of convergence, and Newton's."""

from pathlib import Path

import numpy as np
import skfem
from skfem.helpers import ddot, eye, sym_grad, trace

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import ElasticSystem, LinearElastic, StableNeoHookean, default_solver
from validation.blocks import block, labelled, surface_nodes, two_bones
from validation.newton import equilibrium
from validation.result import Result, Section, picture

AMPLITUDE = np.array([1.0, -0.5, 0.7])


def oracle_difference() -> float:
    """Largest difference from scikit-fem's displacement of a loaded, clamped block, relative to the largest one."""
    rng = np.random.default_rng(0)
    mesh = block((8, 5, 5), size=(2.0, 1.0, 1.0), shake=0.25, rng=rng)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9)
    material = LinearElastic.from_young(3.0, 0.4)
    system = ElasticSystem(mesh, [material])
    load = rng.normal(size=(mesh.n_points, 3))
    found = equilibrium(system, system.rest_state(), load=load, tolerance=1e-9)
    basis = skfem.Basis(
        skfem.MeshTet(mesh.points.T.copy(), mesh.cells.T.astype(np.int64).copy()),
        skfem.ElementVector(skfem.ElementTetP1()), intorder=1,
    )

    @skfem.BilinearForm
    def stiffness(u, v, _):  # type: ignore[no-untyped-def]
        strain = sym_grad(u)
        return ddot(2.0 * material.mu * strain + material.lam * eye(trace(strain), 3), sym_grad(v))

    rhs = np.zeros(basis.N)
    rhs[basis.nodal_dofs] = load.T
    clamped = basis.nodal_dofs[:, mesh.fixed].ravel()
    expected = skfem.solve(*skfem.condense(stiffness.assemble(basis), rhs, D=clamped))[basis.nodal_dofs].T
    return float(np.abs(found.state.points - mesh.points - expected).max() / np.abs(expected).max())


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


def manufactured_error(n: int) -> float:
    """L2 norm of the displacement's error on a cube of n³ cells."""
    material = LinearElastic(mu=1.0, lam=1.5)
    mesh = block((n, n, n))
    mesh = labelled(mesh.points, mesh.cells, fixed=surface_nodes(mesh))
    system = ElasticSystem(mesh, [material])
    # Quadrature of degree 2: four points at barycentric (α, β, β, β).
    alpha, beta = 0.5854101966249685, 0.1381966011250105
    weights = np.full((4, 4), beta) + (alpha - beta) * np.eye(4)
    places = np.einsum("qa,mai->mqi", weights, mesh.points[mesh.cells])
    share = mesh.cell_volumes / 4.0
    load = np.zeros_like(mesh.points)
    np.add.at(load, mesh.cells, np.einsum("mqi,qa,m->mai", body_force(places, material), weights, share))
    found = equilibrium(system, system.rest_state(), load=load, tolerance=1e-10, linear=default_solver())
    exact = AMPLITUDE * np.sin(np.pi * places).prod(axis=-1)[..., None]
    error = np.einsum("qa,mai->mqi", weights, (found.state.points - mesh.points)[mesh.cells]) - exact
    return float(np.sqrt(np.einsum("mqi,mqi,m->", error, error, share)))


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
    results = [Result.at_most("linear elasticity against scikit-fem, relative difference", oracle_difference(), 1e-8)]
    sizes = np.array([4, 8, 12, 16, 24])
    errors = np.array([manufactured_error(int(n)) for n in sizes])
    order = float(np.log(errors[-2] / errors[-1]) / np.log(sizes[-1] / sizes[-2]))
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
