"""The quasi-static solve of one load step: quasi-Newton on factorized tangents.

Equilibrium is r(q) = Jᵀ (∂E/∂x + ∂C/∂x) = 0 in the reduced unknowns q (free soft nodes and the twists of the rigid
parts), with the elastic energy E and the contact energy C. A factorized tangent serves as the first approximation of
the inverse for BFGS updates (H. Matthies and G. Strang, The solution of nonlinear finite element equations,
International Journal for Numerical Methods in Engineering 14, 1979), with their line search: the step length is
accepted where the residual along the search direction has fallen enough, which needs no energy and so allows for
friction. A new tangent is factorized when the updates no longer pay.
"""

import time
from dataclasses import dataclass, field

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.fem.contact import ContactForces, ContactModel, FrictionFrame, ProbePose
from mixpinn.fem.contact_surface import SkinSurface
from mixpinn.fem.linear import LinearSolver, default_solver
from mixpinn.fem.system import ElasticSystem, State


@dataclass(frozen=True)
class SolverConfig:
    """How a step is solved.

    Attributes:
        tolerance: of the residual relative to the contact forces (both Euclidean norms).
        force_floor: forces below this count as this in the relative residual [N].
        max_iterations: of one solve.
        max_cuts: how often a step may be halved before it counts as failed.
        max_move: largest move of a node in one iteration [mm].
        updates: BFGS updates kept before a new factorization.
        slow: a factorization is renewed when an iteration leaves more than this part of the residual.
        threads: of the linear solver and the element kernels; None leaves the libraries' own.
    """

    tolerance: float = 1e-6
    force_floor: float = 1e-3
    max_iterations: int = 60
    max_cuts: int = 5
    max_move: float = 1.5
    updates: int = 12
    slow: float = 0.6
    threads: int | None = None


@dataclass
class Effort:
    """Where the time of solves goes; every entry adds up over the solver's life."""

    iterations: int = 0
    factorizations: int = 0
    evaluations: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: {
        "assembly": 0.0, "factorization": 0.0, "solve": 0.0, "gradient": 0.0, "contact": 0.0,
    })

    def add(self, phase: str, since: float) -> None:
        """Book the time from `since` (of `time.perf_counter`) until now to `phase`."""
        self.seconds[phase] += time.perf_counter() - since


@dataclass(frozen=True, eq=False)
class Balance:
    """Forces at one configuration.

    Attributes:
        state: the configuration.
        internal: gradient of the elastic energy by node positions [N], shape (n, 3).
        contact: contact evaluated on the skin, if any.
        external: gradient of the contact energy by node positions [N], shape (n, 3).
        residual: reduced residual, shape (n_dofs,).
    """

    state: State
    internal: FloatArray
    contact: ContactForces | None
    external: FloatArray
    residual: FloatArray


@dataclass(frozen=True, eq=False)
class StepSolution:
    """Outcome of one solve; `history` holds the relative residual before each iteration and at the end."""

    balance: Balance
    converged: bool
    history: list[float]


class QuasiStaticSolver:
    """Solves one step after another on one mesh, keeping its factorization between them."""

    def __init__(
        self, system: ElasticSystem, contact: ContactModel | None, config: SolverConfig, *,
        linear: LinearSolver | None = None, held: BoolArray | None = None,
    ) -> None:
        """Prepare.

        Args:
            system: elastic bodies.
            contact: None for a problem without contact.
            config: tolerances and limits.
            linear: sparse direct solver; by default the best that the platform has.
            held: reduced unknowns that the solve must not change, shape (n_dofs,).
        """
        self.system, self.contact, self.config = system, contact, config
        self.linear = linear or default_solver(config.threads)
        self.held = held
        self._residual_scale = _residual_scale(system)
        self.effort = Effort()
        self._factorized = False

    def balance(self, state: State, pose: ProbePose | None, frame: FrictionFrame | None) -> Balance:
        """Evaluate all forces at `state`."""
        start = time.perf_counter()
        internal = self.system.gradient(state)
        self.effort.add("gradient", start)
        self.effort.evaluations += 1
        external, forces = np.zeros_like(internal), None
        if self.contact is not None and pose is not None and frame is not None:
            start = time.perf_counter()
            skin = self.contact.skin
            forces = self.contact.evaluate(skin.vertices(state.points), pose, frame)
            for column in range(skin.nodes.shape[1]):
                np.add.at(external, skin.nodes[:, column], skin.weights[:, column, None] * forces.gradient)
            self.effort.add("contact", start)
        residual = self.system.reduce(internal + external, state)
        if self.held is not None:
            residual[self.held] = 0.0
        return Balance(state, internal, forces, external, residual)

    def factorize(self, at: Balance) -> None:
        """Assemble and factorize the tangent at a configuration."""
        start = time.perf_counter()
        blocks = None
        if at.contact is not None and len(at.contact.first):
            assert self.contact is not None
            blocks = _on_nodes(self.contact.skin, at.contact)
        matrix = self.system.tangent(
            at.state, nodal_gradient=at.internal + at.external, blocks=blocks, held=self.held, project=True,
        )
        self.effort.add("assembly", start)
        start = time.perf_counter()
        self.linear.factorize(matrix)
        self.effort.add("factorization", start)
        self.effort.factorizations += 1
        self._factorized = True

    def _apply_inverse(self, vector: FloatArray) -> FloatArray:
        start = time.perf_counter()
        answer = self.linear.solve(vector)
        self.effort.add("solve", start)
        return answer

    def scale(self, balance: Balance) -> float:
        """What the residual is measured against [N]: the norm of the contact forces, at least the floor."""
        return max(float(np.linalg.norm(balance.external)), self.config.force_floor)

    def relative_residual(self, balance: Balance) -> float:
        """Norm of the residual relative to the contact forces; moments count by the arm of the rigid part."""
        return float(np.linalg.norm(balance.residual * self._residual_scale)) / self.scale(balance)

    def solve(self, state: State, pose: ProbePose | None, frame: FrictionFrame | None) -> StepSolution:
        """Find equilibrium from the starting guess `state` with the probe at `pose`.

        Returns:
            The solution, `converged` or not: it is never raised as an error, since a step may be cut and tried again.
        """
        config = self.config
        at = self.balance(state, pose, frame)
        history = [self.relative_residual(at)]
        memory = _Bfgs()
        fresh = False
        while history[-1] > config.tolerance and len(history) <= config.max_iterations:
            if not self._factorized:
                self.factorize(at)
                memory, fresh = _Bfgs(), True
            direction = -memory.apply(self._apply_inverse, at.residual)
            move = self._largest_move(direction)
            descent = float(direction @ at.residual)
            if not np.isfinite(move) or descent >= 0.0:
                if fresh:
                    break
                self._factorized = False
                continue
            if move > config.max_move:
                direction *= config.max_move / move
                descent *= config.max_move / move
            found = self._search(at, direction, descent, pose, frame)
            self.effort.iterations += 1
            if found is None:
                if fresh:
                    break
                self._factorized = False
                continue
            length, new = found
            memory.update(length * direction, new.residual - at.residual)
            at = new
            history.append(self.relative_residual(at))
            fresh = False
            if len(memory) >= config.updates or history[-1] > config.slow * history[-2]:
                self._factorized = False
        return StepSolution(at, history[-1] <= config.tolerance, history)

    def _largest_move(self, direction: FloatArray) -> float:
        """Largest displacement that the increment gives to a soft node [mm]."""
        soft = direction[: self.system.n_dofs - 6 * self.system.mesh.n_parts].reshape(-1, 3)
        return float(np.sqrt((soft**2).sum(axis=1).max(initial=0.0)))

    def _search(
        self, at: Balance, direction: FloatArray, descent: float, pose: ProbePose | None, frame: FrictionFrame | None,
    ) -> tuple[float, Balance] | None:
        """Step length with |dᵀr(q + s d)| ≤ 0.6 |dᵀr(q)| by bracketed secants, or None."""
        low, slope_low, high, slope_high = 0.0, descent, np.inf, np.nan
        length = 1.0
        best: tuple[float, Balance] | None = None
        best_slope = np.inf
        for _ in range(8):
            trial = self.balance(self.system.advance(at.state, length * direction), pose, frame)
            slope = float(direction @ trial.residual)
            if np.isfinite(slope) and abs(slope) < best_slope:
                best, best_slope = (length, trial), abs(slope)
            if np.isfinite(slope) and abs(slope) <= 0.6 * abs(descent):
                return length, trial
            if np.isfinite(slope) and slope < 0.0:
                low, slope_low = length, slope
                if np.isinf(high):
                    return length, trial  # still going downhill at full length: take it
            else:
                high, slope_high = length, slope
            if np.isfinite(slope_high):
                fraction = slope_low / (slope_low - slope_high)
                fraction = min(max(fraction, 0.1), 0.9)
            else:
                fraction = 0.3
            length = low + fraction * (high - low)
        return best if best_slope < abs(descent) else None


def _residual_scale(system: ElasticSystem) -> FloatArray:
    """Factors that turn the residual into forces: a moment counts by the arm of its rigid part, shape (n_dofs,)."""
    mesh = system.mesh
    scale = np.ones(system.n_dofs)
    for k in range(mesh.n_parts):
        points = mesh.points[mesh.part_nodes(k + 1)]
        arm = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
        scale[system.n_dofs - 6 * mesh.n_parts + 6 * k + 3 :][:3] = 1.0 / max(float(arm), 1e-9)
    return scale


def _on_nodes(skin: SkinSurface, contact: ContactForces) -> tuple[IntArray, IntArray, FloatArray]:
    """Stiffness between skin vertices as stiffness between the mesh nodes behind them, each pair of nodes once."""
    if skin.nodes.shape[1] == 1:
        return skin.nodes[contact.first, 0], skin.nodes[contact.second, 0], contact.blocks
    parts = []
    same = contact.first == contact.second
    for i in range(skin.nodes.shape[1]):
        for j in range(skin.nodes.shape[1]):
            first, second = skin.nodes[contact.first, i], skin.nodes[contact.second, j]
            scale = skin.weights[contact.first, i] * skin.weights[contact.second, j]
            # A vertex's own block is symmetric in (i, j): half of the off-diagonal pairs stand for all.
            keep = (~same | (i <= j)) & (scale != 0.0)
            # Two vertices that share a node: block and transpose fall on the same diagonal.
            scale = np.where(~same & (first == second), 2.0 * scale, scale)
            parts.append((first[keep], second[keep], (scale[:, None, None] * contact.blocks)[keep]))
    first, second, blocks = (np.concatenate(column) for column in zip(*parts, strict=True))
    return first, second, blocks


class _Bfgs:
    """Two-loop BFGS recursion around a given inverse (J. Nocedal, Mathematics of Computation 35, 1980)."""

    def __init__(self) -> None:
        self._pairs: list[tuple[FloatArray, FloatArray, float]] = []

    def __len__(self) -> int:
        return len(self._pairs)

    def update(self, step: FloatArray, change: FloatArray) -> None:
        """Remember that the residual changed by `change` over `step`; pairs without curvature are left out."""
        curvature = float(step @ change)
        if curvature > 1e-12 * float(np.linalg.norm(step) * np.linalg.norm(change)):
            self._pairs.append((step, change, 1.0 / curvature))

    def apply(self, inverse, vector: FloatArray) -> FloatArray:  # type: ignore[no-untyped-def]
        """The approximate inverse times `vector`."""
        vector = vector.copy()
        weights = []
        for step, change, rho in reversed(self._pairs):
            weight = rho * float(step @ vector)
            vector -= weight * change
            weights.append(weight)
        vector = inverse(vector)
        for (step, change, rho), weight in zip(self._pairs, reversed(weights), strict=True):
            vector += step * (weight - rho * float(change @ vector))
        return vector
