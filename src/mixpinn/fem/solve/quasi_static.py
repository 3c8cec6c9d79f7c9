"""The quasi-static solve of one load step: quasi-Newton on the elastic body, contact solved exactly in between.

Equilibrium is r(q) + Sᵀ λ = 0 in the reduced unknowns q (free soft nodes and the twists of the rigid parts), with the
elastic residual r = ∂E/∂q of cells and joints and the forces λ of contact. Every iteration linearises r alone and
solves the frictional contact of the linearised body on the patch of skin that the probe can reach
(`mixpinn.physics.condensed_contact`): what changes abruptly is settled there, and what is left for the outer iteration
is smooth. A factorized tangent therefore serves many iterations and load steps, improved by BFGS updates
(`mixpinn.fem.solve.quasi_newton`), and is renewed where an iteration leaves too much of the residual.
"""

import time
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.base.errors import SolveError
from mixpinn.base.sensible import not_negative, positive, require_settings
from mixpinn.fem.contact.model import ContactModel, FrictionFrame
from mixpinn.fem.contact.problem import ContactForces, ContactProblem
from mixpinn.fem.contact.surfaces import SkinPatch
from mixpinn.fem.contact.unknowns import ContactUnknowns, Link
from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.fem.solve.effort import Effort
from mixpinn.fem.solve.halves import in_halves
from mixpinn.fem.solve.linear import LinearSolver, default_solver, symmetric_product
from mixpinn.fem.solve.quasi_newton import UpdatedInverse
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.physics.condensed_contact import solve_condensed

_CONTACT_ITERATIONS = 20
"""Of contact with the linearised body, before it is tried with contact that gives way."""
_CONTACT_SHARE = 0.01
"""How much more closely contact with the linearised body is solved than equilibrium is asked for."""
_SHARES = (1.0 / 256.0, 1.0 / 16.0, 1.0)
"""Shares of the contact's stiffness, one after another: with the first, the probe's weight on soft tissue is borne by
violations of the gap of the order of the gap itself."""
_FACTORIZATIONS = 24
"""Of one solve, at most. Where tissue is about to buckle the tangent is indefinite, and what is factorized in its place
may lead to equilibrium very slowly."""
_PATIENCE = 10
"""An indefinite tangent is factorized without its negative curvature, which is just as far off when it is renewed: so
many iterations are made with it before it is, however slowly the residual falls."""
_SINGLE = 1e-7
"""Down to this tolerance a factorization in single precision does: iterations correct its errors, whose rounding leaves
about 3e-8 of the contact forces."""


@dataclass(frozen=True)
class SolverConfig:
    """How a step is solved.

    Attributes:
        tolerance: of the residual relative to the contact forces (both Euclidean norms); rounding in the stiff contact
            leaves about 1e-9.
        force_floor: forces below this count as this in the relative residual [N].
        max_iterations: of one solve.
        max_cuts: how often a step may be halved before it counts as failed.
        updates: BFGS updates kept before a new factorization.
        slow: a factorization is renewed when an iteration leaves more than this part of the residual.
        threads: of the linear solver and the element kernels; None leaves the libraries' own.
    """

    tolerance: float = 1e-6
    force_floor: float = 1e-3
    max_iterations: int = 40
    max_cuts: int = 5
    updates: int = 30
    slow: float = 0.5
    threads: int | None = None

    def __post_init__(self) -> None:
        require_settings(self, "solver", {
            **positive(self, "tolerance", "force_floor"), "max_iterations": (self.max_iterations >= 1, "at least 1"),
            **not_negative(self, "max_cuts", "updates", "slow"),
            "threads": (self.threads is None or self.threads >= 1, "at least 1"),
        })


@dataclass(frozen=True, eq=False)
class Balance:
    """Forces at one configuration.

    Attributes:
        state: the configuration.
        internal: gradient of the elastic energy by node positions [N], shape (n, 3).
        elastic: the same on the unknowns, r, zero for held ones, shape (n_dofs,).
        contact: contact evaluated on the patch, if any.
        external: gradient of the contact energy by node positions [N], shape (n, 3).
        residual: reduced residual of both, shape (n_dofs,).
    """

    state: State
    internal: FloatArray
    elastic: FloatArray
    contact: ContactForces | None
    external: FloatArray
    residual: FloatArray


@dataclass(frozen=True, eq=False)
class StepSolution:
    """Outcome of one solve; `history` holds the relative residual before each iteration and at the end."""

    balance: Balance
    converged: bool
    history: list[float]
    problem: ContactProblem | None = None


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
        self.linear = linear or default_solver(config.threads, single=config.tolerance >= _SINGLE)
        self.held = held
        self.effort = Effort()
        self._residual_scale = _residual_scale(system)
        self._patch: SkinPatch | None = None
        self._unknowns: ContactUnknowns | None = None
        self._force: FloatArray = np.empty(0)
        self._seat: FloatArray | None = None
        self._inverse: UpdatedInverse | None = None
        self._least, self._age = 0, 0

    @property
    def patch(self) -> SkinPatch | None:
        """The skin on which contact is sought."""
        return self._patch

    def begin(self, patch: SkinPatch | None) -> None:
        """Choose the patch of skin on which contact is sought, and forget earlier solves."""
        self._inverse = self._seat = None
        self.linear.begin()
        if patch is None or self.contact is None or not len(patch.vertices):
            self._patch, self._unknowns, self._force = None, None, np.empty(0)
            return
        self._patch = patch
        self._unknowns = ContactUnknowns(self.system, self.contact.skin, patch, held=self.held)
        self._force = np.zeros(len(self._unknowns.kept))

    def problem(self, pose: ProbePose, frame: FrictionFrame, *, stick: float = 1.0) -> ContactProblem | None:
        """Contact of the probe at `pose` with the patch, `stick` as in `solve`; None without one."""
        if self.contact is None or self._patch is None:
            return None
        return self.contact.problem(self._patch, pose, frame, stick=stick)

    def balance(self, state: State, problem: ContactProblem | None) -> Balance:
        """Evaluate all forces at `state`."""
        start = time.perf_counter()
        internal = self.system.gradient(state)
        elastic = self.system.residual(internal, state)
        self.effort.add("gradient", start)
        self.effort.evaluations += 1
        external, forces, residual = np.zeros_like(internal), None, elastic
        if problem is not None and self._unknowns is not None:
            start = time.perf_counter()
            forces = problem.evaluate(self._unknowns.positions(state))
            external = self._unknowns.on_nodes(forces.gradient)
            residual = elastic + self.system.reduce(external, state)
            self.effort.add("contact", start)
        if self.held is not None:
            elastic, residual = np.where(self.held, 0.0, elastic), np.where(self.held, 0.0, residual)
        return Balance(state, internal, elastic, forces, external, residual)

    def relative_residual(self, balance: Balance) -> float:
        """Norm of the residual relative to the contact forces; moments count by the arm of the rigid part.

        Without contact, relative to the forces at the nodes that are fixed or held.
        """
        scale = float(np.linalg.norm(balance.external))
        if self.contact is None:
            scale = float(np.linalg.norm(balance.internal))
        return float(np.linalg.norm(balance.residual * self._residual_scale)) / max(scale, self.config.force_floor)

    def solve(
        self, state: State, pose: ProbePose | None = None, frame: FrictionFrame | None = None, *, stick: float = 1.0,
    ) -> StepSolution:
        """Find equilibrium from the starting guess `state` with the probe at `pose`.

        Args:
            state: where to start.
            pose: of the probe.
            frame: what friction refers to.
            stick: share of the stiffness with which contact points stick before they slide.

        Returns:
            The solution, `converged` or not: it is never raised as an error, since a step may be cut and tried again.
        """
        problem = None if pose is None or frame is None else self.problem(pose, frame, stick=stick)
        at = self.balance(state, problem)
        history = [self.relative_residual(at)]
        fresh, most = False, self.effort.factorizations + _FACTORIZATIONS
        while history[-1] > self.config.tolerance and len(history) <= self.config.max_iterations:
            if self._inverse is None:
                if self.effort.factorizations >= most:
                    break
                try:
                    self._inverse = self._factorize(at)
                except SolveError:
                    break
                fresh = True
            new = self._iterate(at, problem, history)
            if new is None:
                if fresh:
                    break
                self._inverse = None
                continue
            at = new
            history.append(self.relative_residual(at))
            fresh, self._age = False, self._age + 1
            slow = len(history) > 2 and history[-1] > self.config.slow * history[-2]
            if (slow and self._age >= self._least) or len(self._inverse) >= self.config.updates:
                self._inverse = None
        converged = history[-1] <= self.config.tolerance
        if converged and problem is not None and self._unknowns is not None:
            positions = self._unknowns.positions(at.state)
            converged = not problem.tunnelled(positions)
            self._seat = problem.pose.local(positions) if converged else self._seat
        return StepSolution(at, converged, history, problem)

    def displace(self, state: State, increment: FloatArray) -> State:
        """`state` with the held unknowns moved by `increment` and all others as the linearised body answers.

        Args:
            state: where to start.
            increment: shape (n_dofs,) [mm, rad]; entries of unknowns that are not held are ignored.

        Raises:
            SolveError: the tangent is singular.
        """
        assert self.held is not None
        at = self.balance(state, None)
        start = time.perf_counter()
        matrix = self.system.tangent(state, nodal_gradient=at.internal, project=True)
        imposed = np.where(self.held, increment, 0.0)
        rhs = np.where(self.held, imposed, -at.elastic - symmetric_product(matrix, imposed))
        matrix = self.system.hold(matrix, self.held)
        self.effort.add("assembly", start)
        self._inverse = self._factorize_matrix(matrix)
        return self.system.advance(state, np.where(self.held, imposed, self.linear.solve(rhs)))

    def _iterate(self, at: Balance, problem: ContactProblem | None, history: list[float]) -> Balance | None:
        """One iteration from `at`; None where it leads nowhere."""
        assert self._inverse is not None
        self.effort.iterations += 1
        gradient = at.elastic
        start = time.perf_counter()
        free, force = -self._inverse.look(gradient), None
        self.effort.add("solve", start)
        if problem is not None and self._unknowns is not None:
            start = time.perf_counter()
            force = self._contact_force(at, problem, free, first=len(history) == 1)
            self.effort.add("contact", start)
            if force is None:
                return None
            gradient = gradient.copy()
            gradient[self._unknowns.kept] += force
        start = time.perf_counter()
        step = -self._inverse.step(force)
        self.effort.add("solve", start)
        new, length = self._advance(at, step, problem, history)
        if new is None:
            return None
        start = time.perf_counter()
        self._inverse.learn(length * step, at.elastic, new.elastic, -length * gradient)
        self.effort.add("solve", start)
        return new

    def _contact_force(
        self, at: Balance, problem: ContactProblem, free: FloatArray, *, first: bool,
    ) -> FloatArray | None:
        """Contact forces λ on the kept unknowns in equilibrium with the linearised body."""
        assert self._unknowns is not None
        assert self._inverse is not None
        link, positions = self._unknowns.link(at.state), self._unknowns.positions(at.state)

        def law(y: FloatArray, exact: bool, share: float = 1.0) -> tuple[FloatArray, FloatArray, IntArray]:
            forces = problem.evaluate(positions + link.move(y), exact=exact, share=share)
            return link.reduce(forces.gradient), *link.reduce_stiffness(forces.stiffness, forces.touched)

        gap, compliance = problem.model.config.gap, self._inverse.compliance
        tolerance = min(max(_CONTACT_SHARE * self.config.tolerance, 1e-10), 1e-8)
        solve = partial(solve_condensed, compliance, free, largest_move=0.3 * gap)
        for start in self._starts(link, problem.pose, positions, free, first=first):
            found = solve(law, start=start, tolerance=tolerance, max_iterations=_CONTACT_ITERATIONS)
            self.effort.contact_iterations += found.iterations
            if found.converged:
                self._force = found.force
                return found.force
        # Deep in the probe the curvature of its distance outweighs the body; where contact gives way it does not.
        start = np.asarray(np.linalg.solve(compliance, free), dtype=np.float64)
        for share in _SHARES:
            found = solve(partial(law, share=share), start=start, tolerance=tolerance if share == 1.0 else 1e-3)
            self.effort.contact_iterations += found.iterations
            if not found.converged:
                return None
            start = found.force
        self._force = start
        return start

    def _starts(
        self, link: Link, pose: ProbePose, positions: FloatArray, free: FloatArray, *, first: bool,
    ) -> list[FloatArray]:
        """First guesses of the contact forces λ, the best first.

        A contact is so stiff that forces a little off would leave the skin far from it. So where the skin lies is
        guessed, and λ holds it there, by forces where it was pressed: where it is, or in the first iteration of a
        step, when the probe has just moved, where it lay to the probe at the end of the last. Its last forces are
        good enough where they leave the skin about where it is.
        """
        assert self._inverse is not None
        assert self.contact is not None
        compliance, pressed = self._inverse.compliance, np.flatnonzero(self._force)
        near = np.abs(free - np.einsum("ij,j->i", compliance, self._force)).max(initial=0.0)
        last = [self._force] if near < 0.25 * self.contact.config.gap else []
        there = np.zeros(len(free))
        if first:
            if self._seat is None or link.jacobian is not None:
                return last
            there = link.reduce(pose.place(self._seat) - positions)  # each coordinate is an unknown, or held
        if not len(pressed):
            return [np.zeros(len(free)), *last]
        holding = np.zeros(len(free))
        holding[pressed] = np.linalg.solve(compliance[np.ix_(pressed, pressed)], (free - there)[pressed])
        return [holding] if first else [holding, *last]

    def _advance(
        self, at: Balance, step: FloatArray, problem: ContactProblem | None, history: list[float],
    ) -> tuple[Balance | None, float]:
        """Take the step, or a part of it where the whole makes things worse.

        The residual at the first guess says little, since the probe has just moved: there, forces out of balance
        by as much as the contact forces are still accepted.
        """
        if not np.isfinite(step).all():
            return None, 0.0
        slope = float((step * at.residual).sum())
        allowed = max(1.0, history[0]) if len(history) == 1 else history[-1]
        length = 1.0
        for _ in range(5):
            new = self.balance(self.system.advance(at.state, length * step), problem)
            reached = self.relative_residual(new)
            flat = abs(float((step * new.residual).sum())) < 0.5 * abs(slope)
            if np.isfinite(reached) and (reached <= allowed or flat):
                return new, length
            length *= 0.5
        return None, 0.0

    def _factorize(self, at: Balance) -> UpdatedInverse:
        """Assemble and factorize the tangent of the elastic body at a configuration."""
        nodal = at.internal + at.external
        start = time.perf_counter()
        matrix = self.system.tangent(at.state, nodal_gradient=nodal, held=self.held, project=False)
        self.effort.add("assembly", start)
        inverse = self._factorize_matrix(matrix, definite=True)
        definite = inverse is not None
        if inverse is None:
            start = time.perf_counter()
            matrix = self.system.tangent(at.state, nodal_gradient=nodal, held=self.held, project=True)
            self.effort.add("assembly", start)
            inverse = self._factorize_matrix(matrix)
        assert inverse is not None
        self._least, self._age = 0 if definite else _PATIENCE, 0
        return inverse

    def _factorize_matrix(self, matrix: sp.csr_matrix, *, definite: bool = False) -> UpdatedInverse | None:
        """The inverse; None where the matrix was to be positive definite and is not."""
        start = time.perf_counter()
        kept = np.empty(0, dtype=np.int64) if self._unknowns is None else self._unknowns.kept
        compliance = self.linear.factorize_with_compliance(matrix, kept, definite=definite)
        self.effort.add("factorization", start)
        self.effort.factorizations += 1
        if definite and self.linear.indefinite:
            return None
        return UpdatedInverse(in_halves(self.linear, matrix.shape[0], kept, compliance))


def _residual_scale(system: ElasticSystem) -> FloatArray:
    """Factors that turn the residual into forces: a moment counts by the arm of its rigid part, shape (n_dofs,)."""
    mesh = system.mesh
    scale = np.ones(system.n_dofs)
    for k in range(mesh.n_parts):
        points = mesh.points[mesh.part_nodes(k + 1)]
        arm = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
        scale[system.n_dofs - 6 * mesh.n_parts + 6 * k + 3 :][:3] = 1.0 / max(float(arm), 1e-9)
    return scale
