"""One full solve: the probe pressed to a pose, from first touch or from where an earlier answer ended."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.fem.contact.surfaces import SkinSurface
from mixpinn.fem.scene import Scene
from mixpinn.fem.solve.pose_simulator import Equilibrium, PoseSimulator, loaded_nodes, simulator_of
from mixpinn.fem.solve.refined_pose import RefinedSimulator
from mixpinn.geometry.first_touch import first_touch
from mixpinn.geometry.probe_pose import PATH_STEP, ProbePose
from mixpinn.geometry.rotations import vector_from_rotation
from mixpinn.records import Probe, ProbePath, Simulation
from mixpinn.records.answer import Answer, Contact, Motion, Source, Trust, discretisation_of
from mixpinn.records.probe_valleys import valley_warning


@dataclass(frozen=True, eq=False)
class PressHistory:
    """Where a full solve ended.

    Attributes:
        scene_hash: `Scene.hash` of its scene.
        last: the equilibrium that the next path begins at.
    """

    scene_hash: str
    last: Equilibrium


def solve_pose(
    scene: Scene, tip: FloatArray, rotation: FloatArray, *, history: object | None = None,
    simulator: PoseSimulator | None = None, on_step: Callable[[int, int], None] | None = None,
) -> Answer:
    """Press the probe to a pose and solve for equilibrium with contact and friction, step by step.

    Without a history the path is straight along the pressing direction, from first touch to `tip` in steps of 1 mm.
    With the history of an earlier answer it goes from the pose of that one, in steps of which none moves the tip by
    more than 1 mm. A step that does not converge ends the path: the answer is that of the last step that did, and
    its `trust` says so.

    Args:
        scene: what is pressed with what.
        tip: where the probe's tip ends, world [mm], shape (3,).
        rotation: rotation matrix of the probe, shape (3, 3); it presses along ``rotation @ (0, −1, 0)``.
        history: `Answer.history` of an earlier full solve of this scene.
        simulator: prepared for this scene; by default the last scene's is kept for the next call.
        on_step: called after each step of the path with how many are done, and of how many.

    Raises:
        InputError: a pose that is not finite, or the history of something else, or of a scene with a refinement, whose
            paths all begin at first touch.
    """
    target = _checked_pose(tip, rotation)
    if scene.refinement is not None:
        return _solve_refined(scene, target, history, on_step)
    simulator = simulator or simulator_of(scene)
    start = None if history is None else _checked_history(history, scene)
    if start is None:
        path = _straight_path(scene, target)
        if path is None:
            return _untouched(scene)
    else:
        path = _path_between(start.pose, target)
    count = len(path.depths)
    simulation, last = simulator.follow(
        path, start=start, on_step=None if on_step is None else lambda step: on_step(step + 1, count),
    )
    return _answer(scene, simulation, last, start)


def _solve_refined(
    scene: Scene, target: ProbePose, history: object | None, on_step: Callable[[int, int], None] | None,
) -> Answer:
    """The straight path from first touch on cells that are refined for it."""
    assert scene.refinement is not None
    if history is not None:
        raise InputError(
            "history", expected="none where cells are refined for each path", got="that of an earlier answer",
            fix="begin without a history, or leave the refinement out",
        )
    path = _straight_path(scene, target)
    if path is None:
        return _untouched(scene)
    count = len(path.depths)
    found = RefinedSimulator(scene).run(
        path, on_step=None if on_step is None else lambda step: on_step(step + 1, count),
    )
    done = int(found.converged.sum())
    if not done:
        return replace(_untouched(scene), trust=_trust(found, scene.probe))
    nodes, forces = found.contacts(done - 1)
    displacement, wrench = found.displacement[done - 1], found.probe_wrench[done - 1]
    return Answer(
        scene.mesh, displacement, Source.FULL_SOLVE, model="Full solve", force=wrench[:3], moment=wrench[3:],
        motions=_motions(scene, found.part_translation[done - 1], found.part_rotation[done - 1]),
        contact=Contact(nodes, displacement[nodes], forces), trust=_trust(found, scene.probe),
        discretisation=discretisation_of(scene.mesh, str(scene.refinement)),
    )


def _checked_pose(tip: FloatArray, rotation: FloatArray) -> ProbePose:
    place, turn = np.asarray(tip, dtype=np.float64), np.asarray(rotation, dtype=np.float64)
    if place.shape != (3,) or turn.shape != (3, 3) or not (np.isfinite(place).all() and np.isfinite(turn).all()):
        raise InputError(
            "pose", expected="a finite tip (3,) and rotation (3, 3)", got=f"shapes {place.shape} and {turn.shape}",
            fix="give x, y, z of the tip [mm] and a rotation matrix",
        )
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0.0:
        raise InputError("pose", expected="a rotation matrix", got="another matrix", fix="orthonormalise it")
    return ProbePose(turn, place)


def _checked_history(history: object, scene: Scene) -> Equilibrium:
    if not isinstance(history, PressHistory):
        raise InputError(
            "history", expected="that of a full solve", got=type(history).__name__,
            fix="hand over the history of an answer of the same function",
        )
    if history.scene_hash != scene.hash():
        raise InputError(
            "history", expected="that of the same scene", got="that of another scene", fix="begin without a history",
        )
    return history.last


def _straight_path(scene: Scene, target: ProbePose) -> ProbePath | None:
    """From first touch to `target`; None where the probe does not come within the gap of the skin."""
    skin = scene.skin or SkinSurface.of_mesh(scene.mesh)
    try:
        touch = first_touch(
            target.translation, target.rotation, points=skin.vertices(scene.mesh.node_points),
            triangles=skin.surface.triangles, probe=scene.probe, gap=scene.contact.gap,
        )
    except InputError:  # nothing in the probe's way
        return None
    direction = target.axis
    depth = float((target.translation - touch) @ direction)
    if depth <= 0.0:
        return None
    depths = np.append(np.arange(PATH_STEP, depth - 1e-9, PATH_STEP), depth)
    places = target.translation - (depth - depths)[:, None] * direction
    return ProbePath(places, np.tile(target.rotation, (len(depths), 1, 1)), depths)


def _path_between(start: ProbePose, target: ProbePose) -> ProbePath:
    count = max(1, int(np.ceil(np.linalg.norm(target.translation - start.translation) / PATH_STEP - 1e-9)))
    poses = [start.towards(target, (step + 1) / count) for step in range(count - 1)] + [target]
    return ProbePath(
        np.array([pose.translation for pose in poses]), np.array([pose.rotation for pose in poses]),
        np.arange(1.0, count + 1.0),
    )


def _untouched(scene: Scene) -> Answer:
    """Nothing moves: the probe does not reach the skin."""
    mesh = scene.mesh
    still = Motion(np.zeros(3), np.zeros(3), np.eye(3))
    return Answer(
        mesh, np.zeros((mesh.n_nodes, 3), dtype=np.float32), Source.FULL_SOLVE, model="Full solve",
        force=np.zeros(3), moment=np.zeros(3), motions=dict.fromkeys(mesh.rigid_names, still),
        contact=Contact(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3))),
        trust=Trust(residual=0.0), discretisation=discretisation_of(mesh),
    )


def _answer(scene: Scene, simulation: Simulation, last: Equilibrium, start: Equilibrium | None) -> Answer:
    """The last converged step of `simulation`; the configuration before it where none converged."""
    mesh, done = scene.mesh, int(simulation.converged.sum())
    history = None if start is None and not done else PressHistory(scene.hash(), last)
    state = last.balance.state
    displacement = (state.points - mesh.node_points).astype(np.float32)
    motions = _motions(scene, state.translation, state.rotation)
    external = last.balance.external
    loaded = loaded_nodes(last.balance, scene.skin or SkinSurface.of_mesh(mesh))
    return Answer(
        mesh, displacement, Source.FULL_SOLVE, model="Full solve", force=external.sum(axis=0),
        moment=np.cross(state.points - last.pose.translation, external).sum(axis=0), motions=motions,
        contact=Contact(loaded, displacement[loaded], -external[loaded]),
        trust=_trust(simulation, scene.probe),
        discretisation=discretisation_of(mesh), history=history,
    )


def _motions(scene: Scene, translation: FloatArray, rotation: FloatArray) -> dict[str, Motion]:
    """Motion of each rigid part from translations (K, 3) and rotation matrices (K, 3, 3)."""
    return {
        name: Motion(shift, vector_from_rotation(turn), turn)
        for name, shift, turn in zip(scene.mesh.rigid_names, translation, rotation, strict=True)
    }


def _trust(simulation: Simulation, probe: Probe) -> Trust:
    """Whether all of a path converged, and how far it came where not; a probe with valleys may be why."""
    done, steps = int(simulation.converged.sum()), simulation.n_steps
    depth = f"{simulation.path.depths[done - 1]:g}" if done else "0"
    reasons = () if done == steps else (
        f"the solve stopped at {depth} of {simulation.path.depths[-1]:g} mm; the answer is that of the last step "
        "that converged", *filter(None, [valley_warning(probe.points, probe.triangles)]),
    )
    return Trust(converged=done == steps, residual=float(simulation.residual[min(done, steps - 1)]), reasons=reasons)
