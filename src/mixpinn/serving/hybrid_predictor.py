"""HybridPredictor: a predictor bundle loaded once, with error estimates and refinement by the true solver."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.records import Prediction, TissueMesh
from mixpinn.reduced.hybrid import POSE_FILE, HybridModel, HybridState, load_bundle_mesh
from mixpinn.reduced.prior import contact_nodes
from mixpinn.serving.contact_input import checked_field, contact_field

if TYPE_CHECKING:
    from mixpinn.press.model import PoseModel, PosePrediction
    from mixpinn.press.records import ContactHistory


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


@dataclass(frozen=True)
class ProbeAddress:
    """A pose of the probe: position of its tip [mm] and rotation about its pressing direction −y [degree]."""

    tip: tuple[float, float, float]
    rotation_deg: float = 0.0

    @staticmethod
    def read(text: str, rotation_deg: float) -> "ProbeAddress":
        """From 'x,y,z'.

        Raises:
            InputError: not three finite numbers.
        """
        try:
            x, y, z = (float(word) for word in text.split(","))
        except ValueError:
            x = y = z = np.nan
        if not np.isfinite([x, y, z, rotation_deg]).all():
            raise InputError(
                "tip", expected="three numbers 'x,y,z' [mm]", got=repr(text), fix="for example --tip=-10,120.5,35",
            )
        return ProbeAddress((x, y, z), rotation_deg)


class HybridPredictor:
    """The hybrid model on its mesh of n nodes.

    Attributes:
        name: of the model, for tables.
        model: prior, modes, gain and calibration.
        mesh: the mesh that it belongs to.
        threads: for the predictor of a network; a hybrid prediction runs in the thread that asks for it.
        pose: contact from the probe's pose; None where the bundle has none.
        loading_seconds: how long loading and warming up took [s].

    Example:
        >>> predictor = HybridPredictor.load("runs/hybrid")
        >>> nodes, moved = predictor.model.prior.nodes[:2], [[0.0, -3.0, 0.0], [0.0, -2.8, 0.1]]
        >>> predictor.predict_at(nodes, moved).save("deformed.vtu")
        >>> trust = predictor.assess(nodes, moved)
        >>> bool(trust.expected < trust.bound)
        True
    """

    def __init__(self, model: HybridModel, *, pose: "PoseModel | None" = None, threads: int | None = None) -> None:
        if threads is not None and threads < 1:
            raise InputError("threads", expected="at least 1", got=str(threads), fix="give a positive number")
        self.model, self.mesh, self.name, self.threads, self.pose = model, model.mesh, model.name, threads, pose
        self.loading_seconds = 0.0

    @staticmethod
    def load(
        folder: Path | str, *, mesh: TissueMesh | None = None, threads: int | None = None, name: str | None = None,
    ) -> "HybridPredictor":
        """Read a bundle and make one prediction, so that the next one is not slowed down by compilation.

        Args:
            folder: what fitting the hybrid model wrote.
            mesh: the mesh that it is to be used on; None takes the folder's own.
            threads: for the predictor of a network; a hybrid prediction runs in the thread that asks for it.
            name: for tables.

        Raises:
            InputError: the folder is incomplete, damaged, or of another mesh.
        """
        began = time.perf_counter()
        model = HybridModel.load(folder, mesh or load_bundle_mesh(folder))
        pose = None
        if (Path(folder) / POSE_FILE).is_file():
            # Imported here: contact needs the solver's geometry, which predicting from contact displacements does not.
            from mixpinn.press.files import load_pose_model

            pose = load_pose_model(folder, model)
        predictor = HybridPredictor(model, pose=pose, threads=threads)
        predictor.name = name or model.name
        warm = np.zeros((model.mesh.n_points, 3), dtype=np.float32)
        warm[model.prior.nodes[:2], 1] = -0.1
        predictor.predict(warm)
        if pose is not None:
            predictor.press(model.mesh.points[model.prior.nodes].max(axis=0)[None])
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

    def press(
        self, tips: AnyArray, *, rotation_deg: AnyArray | None = None, rotations: AnyArray | None = None,
        direction: Sequence[float] = (0.0, -1.0, 0.0), history: "ContactHistory | None" = None,
    ) -> "PosePrediction":
        """Deformation from the poses of one or several probes that press at the same time.

        Without a history each probe came straight along its axis, and the answer does not depend on what was asked
        before. With the `contact.history` of an earlier answer friction remembers where the skin was gripped.

        Args:
            tips: position of each probe's tip [mm], shape (k, 3).
            rotation_deg: rotation of each about its pressing direction [degree], shape (k,); zero by default.
            direction: in which all press that are given by their `rotation_deg`, shape (3,).
            rotations: rotation matrix of each instead, shape (k, 3, 3).
            history: of an earlier answer.

        Raises:
            InputError: a bundle without contact from the pose, or poses that are not finite or no rotations.
        """
        if self.pose is None:
            raise InputError(
                self.name, expected="a bundle that takes poses", got="one that was made without a probe",
                fix="fit the hybrid model on simulations of this project",
            )
        tips = np.asarray(tips, dtype=np.float64).reshape(-1, 3)
        if rotations is None:
            degrees = np.zeros(len(tips)) if rotation_deg is None else np.asarray(rotation_deg, dtype=np.float64)
            rotations = probe_rotation(degrees.reshape(-1), direction)
        return self.pose.predict(rotations, tips, probes=[0] * len(tips), history=history)

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
        from mixpinn.reduced.newton_steps import NewtonSteps

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
        found = contact_nodes(field)
        if not len(found):
            raise InputError(
                "contact displacements", expected="at least one that is not zero", got="zeros",
                fix="give the displacement of the nodes that the probe moves",
            )
        return self.model.solve(found, field[found])
