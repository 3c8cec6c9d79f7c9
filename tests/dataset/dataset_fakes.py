"""A small block and runners that answer at once, importable by name from worker processes."""

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mixpinn.base.errors import SolveError
from mixpinn.dataset import Pose, Protocol, SimulationStore, list_poses
from mixpinn.fem import scene_record
from mixpinn.records import Probe, ProbePath, Simulation, TissueMesh
from validation.kuhn import grid_points, kuhn_cells


def block(n: int = 4, *, size: float = 10.0, rigid: bool = True) -> TissueMesh:
    """n × n × n nodes, `size` mm apart, top at y = 0, six tetrahedra a cube; one inner column of nodes is rigid."""
    index = np.arange(n**3).reshape(n, n, n)
    points = grid_points(*[size * np.arange(n)] * 3)
    points -= [size * (n - 1) / 2.0, size * (n - 1), size * (n - 1) / 2.0]
    cells = kuhn_cells((n - 1, n - 1, n - 1))
    part = np.zeros(n**3, dtype=np.int16)
    if rigid:
        part[index[1: n - 1, 1: n - 1, 1: n - 1].ravel()] = 1
    return TissueMesh(
        points, cells, part, points[:, 1] == points[:, 1].min(), ("L1",) if rigid else (),
        np.zeros(len(cells), dtype=np.int16),
    )


def plate(width: float = 4.0) -> Probe:
    """A flat square of `width` mm whose centre is the tip."""
    half = width / 2.0
    points = np.array([[-half, 0, -half], [half, 0, -half], [half, 0, half], [-half, 0, half]], dtype=float)
    return Probe(points, np.array([[0, 1, 2], [0, 2, 3]]), "plate")


@dataclass(frozen=True, eq=False)
class FakeScene:
    """A scene for `fake_runner`.

    Attributes:
        mesh, probe: as in a real scene.
        log: folder in which each run leaves a file.
        trouble: position index to what happens there: ``die`` always, ``die once``, ``stop`` always, ``stop once``,
            ``raise``, ``end parent``, ``unconverged``.
        pause: seconds that each step takes.
    """

    mesh: TissueMesh
    probe: Probe = field(default_factory=plate)
    log: Path | None = None
    trouble: dict[int, str] = field(default_factory=dict)
    pause: float = 0.0

    def runs(self) -> list[str]:
        """Names of the poses that were begun, in order of time."""
        assert self.log is not None
        begun = sorted(self.log.iterdir(), key=lambda path: int(path.name.split(".")[1]))
        return [path.name.split(".")[0] for path in begun]


def fake_simulation(mesh: TissueMesh, path: ProbePath, *, position_index: int, rotation_deg: float) -> Simulation:
    """Step of depth d > 0: top node `position_index` goes down by d and carries d N; its neighbour is listed only."""
    rng = np.random.default_rng([position_index, round(rotation_deg)])
    top = np.flatnonzero(mesh.node_points[:, 1] == mesh.points[:, 1].max())
    near = np.array([top[position_index % len(top)], top[(position_index + 1) % len(top)]])
    steps = len(path)
    pressed = np.maximum(path.depths, 0.0)
    displacement = (rng.normal(size=(steps, mesh.n_nodes, 3)) * 1e-3 * pressed[:, None, None]).astype(np.float32)
    displacement[:, near[0], 1] = -pressed
    touching = path.depths > -2.0
    offsets = np.concatenate([[0], np.cumsum(2 * touching)])
    forces = np.zeros((2 * int(touching.sum()), 3))
    forces[0::2, 1] = -pressed[touching]
    wrench = np.zeros((steps, 6))
    wrench[:, 1] = pressed
    return Simulation(
        mesh_hash=mesh.hash(), position_index=position_index, rotation_deg=rotation_deg, path=path,
        displacement=displacement, contact_offsets=offsets, contact_nodes=np.tile(near, int(touching.sum())),
        contact_forces=forces, probe_wrench=wrench,
        part_rotation=np.tile(np.eye(3), (steps, mesh.n_parts, 1, 1)),
        part_translation=np.zeros((steps, mesh.n_parts, 3)),
        converged=np.ones(steps, dtype=bool), residual=np.full(steps, 1e-8) * (1 + position_index),
        iterations=np.full(steps, 3), energy=pressed**2, min_jacobian=1.0 - 0.01 * pressed,
        penetration=np.full(steps, 0.01), seconds=np.full(steps, 0.5),
    )


def fake_runner(
    scene: FakeScene, path: ProbePath, *, position_index: int, rotation_deg: float,
    on_step: Callable[[int], None] | None = None,
) -> Simulation:
    """Log the run, make the trouble that the scene asks for at this position, and answer."""
    name = Pose(position_index, (0.0, 0.0, 0.0), rotation_deg).name
    before = 0
    if scene.log is not None:
        before = len(list(scene.log.glob(f"{name}.*")))
        (scene.log / f"{name}.{time.time_ns()}").touch()
    trouble = scene.trouble.get(position_index, "")
    if trouble == "die" or (trouble == "die once" and not before):
        os.kill(os.getpid(), signal.SIGKILL)
    if trouble == "stop" or (trouble == "stop once" and not before):
        os.kill(os.getpid(), signal.SIGSTOP)
    if trouble == "end parent":
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(0.5)
    if trouble == "raise":
        raise SolveError("no equilibrium")
    for step in range(len(path)):
        time.sleep(scene.pause)
        if on_step is not None:
            on_step(step)
    result = fake_simulation(scene.mesh, path, position_index=position_index, rotation_deg=rotation_deg)
    if trouble == "unconverged":
        result.converged[-2:] = False
    return result


SHORT = Protocol(rotations=(0.0, 90.0), approach=2.0, steps=6)


def short_store(
    folder: Path, scene: FakeScene, *, positions: int = 3, protocol: Protocol = SHORT,
) -> SimulationStore:
    """A store of `positions` × the protocol's rotations on the scene's mesh."""
    places = np.column_stack([np.arange(positions, dtype=float), np.zeros(positions), np.zeros(positions)])
    identity = {key: value for key, value in scene_record(scene).items() if key == "probe"}
    return SimulationStore.create(
        folder, scene.mesh, protocol=protocol, positions=places, poses=list_poses(places, protocol), scene=identity,
    )


def filled_store(folder: Path, scene: FakeScene, **kwargs: int) -> SimulationStore:
    """`short_store` with every pose simulated in this process."""
    store = short_store(folder, scene, **kwargs)
    from mixpinn.dataset import run_pose

    for pose in store.poses:
        run_pose(store, scene, fake_runner, pose)
    return store


class Stubborn:
    """A scene that cannot be taken over by its worker as it should: what happens when it is unpickled.

    Attributes:
        scene: what it is in the end.
        trouble: ``raise``, or a signal that the worker gets while it starts.
        marks: where a file is left at each start; the trouble comes the first `times` times.
    """

    def __init__(self, scene: FakeScene, trouble: str | int, marks: Path, *, times: int = 99) -> None:
        self.scene, self.trouble, self.marks, self.times = scene, trouble, marks, times

    def __reduce__(self) -> tuple[object, ...]:
        return _take_over, (self.scene, self.trouble, self.marks, self.times)


def _take_over(scene: FakeScene, trouble: str | int, marks: Path, times: int) -> FakeScene:
    begun = len(list(marks.iterdir()))
    (marks / f"start_{begun}").touch()
    if begun < times:
        if trouble == "raise":
            raise ImportError("no module named like this")
        os.kill(os.getpid(), int(trouble))
    return scene
