"""HybridPredictor: a predictor bundle loaded once, with error estimates and refinement by the true solver."""

import time
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.models import MESH_FILE
from mixpinn.models.hybrid import HybridModel, HybridState, contact_nodes
from mixpinn.records import Prediction, TissueMesh
from mixpinn.serving.predictor import checked_field, contact_field


@dataclass(frozen=True, eq=False)
class Assessment:
    """What to think of a prediction.

    Attributes:
        expected: expected mean Euclidean error [mm].
        bound: what it stays below with probability `level` [mm].
        level: probability of the bound.
        outside: whether the input lies outside of what the model has seen; the two figures mean little then.
        milliseconds: what the assessment cost [ms].
    """

    expected: float
    bound: float
    level: float
    outside: bool
    milliseconds: float


class HybridPredictor:
    """The hybrid model on its mesh of n nodes.

    Attributes:
        name: of the model, for tables.
        model: prior, modes, gain and calibration.
        mesh: the mesh that it belongs to.
        threads: CPU threads of a prediction; None leaves them as they are.
        loading_seconds: how long loading and warming up took [s].

    Example:
        >>> predictor = HybridPredictor.load("runs/hybrid")
        >>> nodes, moved = [512, 513], [[0.0, -3.0, 0.0], [0.0, -2.8, 0.1]]
        >>> predictor.predict_at(nodes, moved).save("deformed.vtu")
        >>> predictor.assess(nodes, moved).bound
    """

    def __init__(self, model: HybridModel, *, threads: int | None = None) -> None:
        if threads is not None and threads < 1:
            raise InputError("threads", expected="at least 1", got=str(threads), fix="give a positive number")
        self.model, self.mesh, self.name, self.threads = model, model.mesh, model.name, threads
        self.loading_seconds = 0.0

    @staticmethod
    def load(
        folder: Path | str, *, mesh: TissueMesh | None = None, threads: int | None = None, name: str | None = None,
    ) -> "HybridPredictor":
        """Read a bundle and make one prediction, so that the next one is not slowed down by compilation.

        Args:
            folder: what fitting the hybrid model wrote.
            mesh: the mesh that it is to be used on; None takes the folder's own.
            threads: CPU threads of a prediction; None leaves them as they are.
            name: for tables.

        Raises:
            InputError: the folder is incomplete, damaged, or of another mesh.
        """
        began = time.perf_counter()
        model = HybridModel.load(folder, mesh or TissueMesh.load(Path(folder) / MESH_FILE))
        predictor = HybridPredictor(model, threads=threads)
        predictor.name = name or model.name
        warm = np.zeros((model.mesh.n_points, 3), dtype=np.float32)
        warm[model.prior.nodes[:2], 1] = -0.1
        predictor.predict(warm)
        predictor.loading_seconds = time.perf_counter() - began
        return predictor

    @property
    def mesh_hash(self) -> str:
        """Identity of the mesh."""
        return self.mesh.hash()

    def predict(self, contact_displacement: AnyArray) -> Float32Array:
        """Displacement of every mesh node [mm], float32, shape (n, 3).

        Args:
            contact_displacement: of the contact nodes, zero elsewhere [mm], shape (n, 3).

        Raises:
            InputError: another shape, values that are not finite, or nodes that the prior was not prepared for.
        """
        field = checked_field(contact_displacement, n_nodes=self.mesh.n_points)
        self._set_threads()
        return self.model.predict(field)

    def predict_at(
        self, nodes: AnyArray, displacements: AnyArray, *, reference: AnyArray | None = None,
    ) -> Prediction:
        """Predict from a list of contact nodes: ids (c,), displacements [mm] (c, 3); reference [mm] (n, 3) if known.

        Raises:
            InputError: unknown or repeated nodes, another shape, or values that are not finite.
        """
        field = contact_field(nodes, displacements, n_nodes=self.mesh.n_points)
        return Prediction(self.mesh, self.predict(field), reference, self.name)

    def assess(self, nodes: AnyArray, displacements: AnyArray) -> Assessment | None:
        """Which error to expect of the prediction from these contact nodes; None where the model is not calibrated.

        Raises:
            InputError: as `predict_at`.
        """
        if self.model.error is None:
            return None
        state = self._state(nodes, displacements)
        began = time.perf_counter()
        signs = self.model.signs(state)
        error = self.model.error
        return Assessment(
            error.expected(signs), error.bound(signs), error.level, error.outside(signs),
            1e3 * (time.perf_counter() - began),
        )

    def refine(self, nodes: AnyArray, displacements: AnyArray, steps: int) -> tuple[Prediction, FloatArray]:
        """Steps of the true solver from the prediction, down to the finite-element solution. Imports the solver.

        Args:
            nodes, displacements: as `predict_at`.
            steps: Newton steps, each with a factorization.

        Returns:
            The refined prediction, and the residual relative to the contact force before each step and after the last.

        Raises:
            InputError: as `predict_at`, or a negative number of steps.
        """
        if steps < 0:
            raise InputError("steps", expected="0 or more", got=str(steps), fix="give how many Newton steps to take")
        from mixpinn.fem import StableNeoHookean
        from mixpinn.models.newton_steps import NewtonSteps

        equilibrium = self.model.newton.equilibrium
        materials = [
            StableNeoHookean(mu=float(mu), lam=float(lam))
            for mu, lam in zip(equilibrium.mu, equilibrium.lam, strict=True)
        ]
        state = self._state(nodes, displacements)
        field, history = NewtonSteps(self.model.prior, materials).refine(state.unknowns, state.contact, steps)
        return Prediction(self.mesh, field, None, f"{self.name}, refined"), history

    def _state(self, nodes: AnyArray, displacements: AnyArray) -> HybridState:
        field = contact_field(nodes, displacements, n_nodes=self.mesh.n_points)
        self._set_threads()
        found = contact_nodes(field)
        if not len(found):
            raise InputError(
                "contact displacements", expected="at least one that is not zero", got="zeros",
                fix="give the displacement of the nodes that the probe moves",
            )
        return self.model.solve(found, field[found])

    def _set_threads(self) -> None:
        if self.threads is not None:
            numba.set_num_threads(min(self.threads, numba.config.NUMBA_NUM_THREADS))
