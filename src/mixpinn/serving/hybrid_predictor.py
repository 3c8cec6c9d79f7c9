"""HybridPredictor: a predictor bundle loaded once, with error estimates and refinement by the true solver."""

import contextlib
import time
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Answer, Contact, Source, Trust, discretisation_of
from mixpinn.records.error_budget import ErrorBudget, TotalError
from mixpinn.reduced.compliance.forms import read_ahead
from mixpinn.reduced.hybrid import POSE_FILE, HybridModel, HybridState, load_bundle_mesh
from mixpinn.reduced.outputs import Outputs
from mixpinn.serving.bundle_budget import load_budget
from mixpinn.serving.contact_input import checked_contact, checked_history
from mixpinn.serving.motions import motions_of_field, motions_of_twists

if TYPE_CHECKING:
    from mixpinn.press.model import PoseModel, PosePrediction
    from mixpinn.serving.force_depth import DepthForForce


class HybridPredictor:
    """The hybrid model on its mesh of n nodes.

    Attributes:
        name: of the model, for tables.
        model: prior, modes, gain and calibration.
        mesh: the mesh that it belongs to.
        threads: for the predictor of a network; a hybrid prediction runs in the thread that asks for it.
        pose: contact from the probe's pose; None where the bundle has none.
        budget: how far its answers are from the converged solution; None where the bundle does not know.
        loading_seconds: how long loading and warming up took [s].

    Example:
        >>> predictor = HybridPredictor.load("runs/hybrid")
        >>> nodes, moved = predictor.model.prior.nodes[:2], [[0.0, -3.0, 0.0], [0.0, -2.8, 0.1]]
        >>> predictor.predict_at(nodes, moved).save("deformed.vtu")
        >>> trust = predictor.assess(nodes, moved)
        >>> bool(trust.expected < trust.bound)
        True
    """

    def __init__(
        self, model: HybridModel, *, pose: "PoseModel | None" = None, threads: int | None = None,
        budget: ErrorBudget | None = None,
    ) -> None:
        if threads is not None and threads < 1:
            raise InputError("threads", expected="at least 1", got=str(threads), fix="give a positive number")
        self.model, self.mesh, self.name, self.threads, self.pose = model, model.mesh, model.name, threads, pose
        self.budget, self.loading_seconds = budget, 0.0

    @staticmethod
    def load(
        folder: Path | str, *, mesh: TissueMesh | None = None, threads: int | None = None, name: str | None = None,
        warm_up: bool = True, with_budget: bool = True,
    ) -> "HybridPredictor":
        """Read a bundle.

        Args:
            folder: what fitting the hybrid model wrote.
            mesh: the mesh that it is to be used on; None takes the folder's own.
            threads: for the predictor of a network; a hybrid prediction runs in the thread that asks for it.
            name: for tables.
            warm_up: make one prediction, so that the next one is not slowed down by compilation.
            with_budget: also read the error budget that it carries.

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
        budget = load_budget(folder, model.mesh) if with_budget else None
        predictor = HybridPredictor(model, pose=pose, threads=threads, budget=budget)
        predictor.name = name or model.name
        if warm_up:
            predictor.predict(model.prior.nodes[:2], np.tile([0.0, -0.1, 0.0], (2, 1)))
            if pose is not None:
                back = model.mesh.node_points[model.prior.nodes]
                with contextlib.suppress(InputError):  # where it touches, so that the kernels of contact are compiled
                    predictor.press(back[back[:, 1].argmax()] - [0.0, 1.0, 0.0])
        predictor.loading_seconds = time.perf_counter() - began
        return predictor

    def read_ahead(self) -> None:
        """Read now what of the bundle is otherwise read where it is first needed.

        Later answers do not wait for the disk then, and memory does not grow with the places that are pressed.
        """
        read_ahead(self.model.prior.compliance)

    @property
    def pressing(self) -> "PoseModel":
        """Contact from the probe's pose.

        Raises:
            InputError: a bundle that was made without a probe.
        """
        if self.pose is None:
            raise InputError(
                self.name, expected="a bundle that takes poses", got="one that was made without a probe",
                fix="fit the hybrid model on simulations that know their probe",
            )
        return self.pose

    @cached_property
    def total(self) -> TotalError | None:
        """How far answers may be from the converged solution, where the bundle knows it."""
        return None if self.budget is None else self.budget.total

    @cached_property
    def _discretisation(self) -> str:
        return self.model.made_on

    @property
    def mesh_hash(self) -> str:
        """Identity of the mesh."""
        return self.mesh.hash()

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of every mesh node [mm], float32, shape (n, 3).

        Args:
            nodes: ids of the contact nodes, each once, shape (c,).
            displacements: displacement of each of them [mm], shape (c, 3).

        Raises:
            InputError: unknown or repeated nodes, nodes that the prior was not prepared for, another shape, or
                values that are not finite.
        """
        return self.model.expand(self._state(nodes, displacements))

    def outputs(self, nodes: AnyArray | None = None) -> Outputs:
        """What predicts the displacement of some nodes alone, for less than that of all; prepared once, used often.

        Its contacts are checked as those of `predict`.

        Args:
            nodes: which, shape (k,): skin, parts, any of the mesh; None for its vertices.

        Raises:
            InputError: a node that the mesh does not have.
        """
        chosen = np.arange(self.mesh.n_points) if nodes is None else nodes
        return Outputs(self.model, chosen, checked=self._checked)

    def predict_at(self, nodes: AnyArray, displacements: AnyArray, *, reference: AnyArray | None = None) -> Answer:
        """The whole answer to contact displacements; operands and errors as in `predict`.

        Args:
            nodes, displacements: as in `predict`.
            reference: what is to be predicted, if known [mm], shape (n, 3).
        """
        state = self._state(nodes, displacements)
        return Answer(
            self.mesh, self.model.expand(state), Source.HYBRID_CONTACT, model=self.name,
            motions=motions_of_twists(self.mesh, self.model.prior.coordinates.twists(state.unknowns)),
            contact=Contact(*self._checked(nodes, displacements)), trust=self._trust(state),
            discretisation=self._discretisation, reference=reference, total=self.total,
        )

    def press(
        self, tip: AnyArray | Sequence[float], *, rotation_deg: AnyArray | float = 0.0,
        direction: Sequence[float] = (0.0, -1.0, 0.0), rotation: AnyArray | None = None,
        history: object | None = None,
    ) -> Answer:
        """The whole answer to the probe's pose.

        Without a history the probe came straight along its axis, and the answer does not depend on what was asked
        before. With the history of an earlier answer friction remembers where the skin was gripped.

        Args:
            tip: where the probe's tip ends, world [mm], shape (3,); (k, 3) for k probes that press at the same time.
            rotation_deg: rotation of the probe about the pressing direction [degree]; shape (k,) for k probes.
            direction: where it presses to, of any length, shape (3,).
            rotation: rotation matrix of the probe instead of these two, shape (3, 3); (k, 3, 3) for k probes.
            history: `Answer.history` of an earlier answer.

        Raises:
            InputError: a bundle without contact from the pose, a pose that is not finite or no rotation, one beyond
                sense (far inside the body, or pressing from another side), or the history of something else.
        """
        model = self.pressing
        tips = np.asarray(tip, dtype=np.float64)
        places = tips.reshape(-1, 3)
        if rotation is None:
            rotation = probe_rotation(np.broadcast_to(rotation_deg, len(places)), direction)
        turns = np.asarray(rotation, dtype=np.float64).reshape(-1, 3, 3)
        found = model.predict(turns, places, probes=[0] * len(places), history=checked_history(history))
        return self.answer_of(found, alone=tips.ndim == 1)

    def answer_of(self, found: "PosePrediction", *, alone: bool = False) -> Answer:
        """The answer that a prediction from poses makes.

        Args:
            found: by `pressing`.
            alone: of one probe, whose force and moment are (3,) instead of (k, 3).
        """
        contact, wrench = found.contact, found.wrench[0] if alone else found.wrench
        return Answer(
            self.mesh, found.displacement, Source.HYBRID_POSE, model=self.name, force=wrench[..., :3],
            moment=wrench[..., 3:], motions=motions_of_twists(self.mesh, found.twists),
            contact=Contact(contact.nodes, contact.displacement, contact.forces),
            trust=found.trust, discretisation=self._discretisation, history=contact.history,
            total=self.total,
        )

    def press_many(
        self, tips: AnyArray | Sequence[Sequence[float]], *, rotation_deg: AnyArray | float = 0.0,
        direction: Sequence[float] = (0.0, -1.0, 0.0), rotations: AnyArray | None = None, threads: int | None = None,
    ) -> list[Answer]:
        """The answers of `press` to many poses of one probe, from several processes or threads; see `many_poses`.

        Args:
            tips: where the tip ends in each, world [mm], shape (m, 3).
            rotation_deg: about the pressing direction [degree], one for all or shape (m,).
            direction: where it presses to, shape (3,).
            rotations: rotation matrices instead of these two, shape (m, 3, 3).
            threads: how many, and no processes; None takes every core.

        Raises:
            InputError: as `press`; the pose is named.
        """
        from mixpinn.serving.many_poses import press_many

        return press_many(
            self, tips, rotation_deg=rotation_deg, direction=direction, rotations=rotations, threads=threads,
        )

    def depth_for(
        self, force: float, tip: AnyArray | Sequence[float], *, rotation_deg: float = 0.0,
        direction: Sequence[float] = (0.0, -1.0, 0.0), rotation: AnyArray | None = None, tolerance: float = 0.1,
    ) -> "DepthForForce":
        """How deep a probe must press to feel a force.

        Args:
            force: size of the force that is wanted [N].
            tip: a place on the line along which it presses [mm], shape (3,).
            rotation_deg, direction, rotation: of the probe, as in `press`.
            tolerance: by how much the force may be off [N].

        Raises:
            InputError: a force that the pose cannot reach within the depth that was learned from; the range that it can
                is named.
        """
        from mixpinn.serving.force_depth import depth_for

        return depth_for(
            self, force, tip, rotation_deg=rotation_deg, direction=direction, rotation=rotation, tolerance=tolerance,
        )

    def stiffness(
        self, tip: AnyArray | Sequence[float], *, rotation_deg: float = 0.0,
        direction: Sequence[float] = (0.0, -1.0, 0.0), rotation: AnyArray | None = None,
        history: object | None = None, threads: int | None = None,
    ) -> FloatArray:
        """The derivative of force and moment by the probe's pose, shape (6, 6); see `mixpinn.serving.stiffness`.

        Args:
            tip, rotation_deg, direction, rotation, history: of the probe, as in `press`.
            threads: how many; None takes every core.

        Raises:
            InputError: as `press`.
            SolveError: contact did not converge.
        """
        from mixpinn.serving.stiffness import stiffness

        return stiffness(
            self, tip, rotation_deg=rotation_deg, direction=direction, rotation=rotation, history=history,
            threads=threads,
        )

    def assess(self, nodes: AnyArray, displacements: AnyArray) -> Trust:
        """What to think of the prediction from these contact nodes; operands and errors as in `predict`."""
        return self._trust(self._state(nodes, displacements))

    def refine(self, nodes: AnyArray, displacements: AnyArray, steps: int) -> tuple[Answer, FloatArray]:
        """Steps of the true solver from the prediction, down to the finite-element solution. Imports the solver.

        Args:
            nodes, displacements: as in `predict`.
            steps: Newton steps, each with a factorization.

        Returns:
            The refined answer, and the residual relative to the contact force before each step and after the last.

        Raises:
            InputError: as in `predict`, or a negative number of steps.
        """
        if steps < 0:
            raise InputError("steps", expected="0 or more", got=str(steps), fix="give how many Newton steps to take")
        from mixpinn.fem import SolverConfig, StableNeoHookean
        from mixpinn.reduced.newton_steps import NewtonSteps

        equilibrium = self.model.newton.equilibrium
        materials = [
            StableNeoHookean(mu=float(mu), lam=float(lam))
            for mu, lam in zip(equilibrium.mu, equilibrium.lam, strict=True)
        ]
        state = self._state(nodes, displacements)
        field, residuals = NewtonSteps(self.model.prior, materials).refine(state.unknowns, state.contact, steps)
        answer = Answer(
            self.mesh, field, Source.REFINED, model=f"{self.name}, refined",
            motions=motions_of_field(self.mesh, field), contact=Contact(*self._checked(nodes, displacements)),
            trust=Trust(converged=bool(residuals[-1] <= SolverConfig().tolerance), residual=float(residuals[-1])),
            discretisation=discretisation_of(self.mesh),
        )
        return answer, residuals

    def _checked(self, nodes: AnyArray, displacements: AnyArray) -> tuple[IntArray, Float32Array]:
        return checked_contact(nodes, displacements, n_nodes=self.mesh.n_nodes)

    def _state(self, nodes: AnyArray, displacements: AnyArray) -> HybridState:
        held, moved = self._checked(nodes, displacements)
        return self.model.solve(held, moved)

    def _trust(self, state: HybridState, *, converged: bool = True) -> Trust:
        """From what the equilibrium says of a prediction; errors are unknown where the model is not calibrated."""
        reasons = () if converged else ("contact did not converge",)
        error = self.model.error
        if error is None:
            return Trust(converged=converged, reasons=reasons)
        signs = self.model.signs(state)
        outside = error.outside(signs)
        if outside:
            reasons = (*reasons, "the deformation lies outside of what the model has seen")
        return Trust(error.expected(signs), error.bound(signs), error.level, outside, reasons, converged)
