"""Sample table: from simulations to samples."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path
from mixpinn.base.progress import track
from mixpinn.dataset.protocol import Pose
from mixpinn.dataset.status import PoseState
from mixpinn.dataset.store import SimulationStore
from mixpinn.records import SampleTable, Simulation

ContactRule = Literal["loaded", "listed"]
"""Contact nodes of a sample: those with force, or all within the alarm distance, as SOFA lists them."""


class _Columns:
    """Everything of a table but the displacement, collected simulation by simulation."""

    def __init__(self) -> None:
        self.position: list[IntArray] = []
        self.rotation: list[FloatArray] = []
        self.depth: list[FloatArray] = []
        self.translation: list[FloatArray] = []
        self.turn: list[FloatArray] = []
        self.wrench: list[FloatArray] = []
        self.nodes: list[IntArray] = []
        self.forces: list[FloatArray] = []

    def add(self, simulation: Simulation, steps: IntArray, contact: ContactRule) -> None:
        self.position.append(np.full(len(steps), simulation.position_index, dtype=np.int64))
        self.rotation.append(np.full(len(steps), simulation.rotation_deg))
        self.depth.append(simulation.path.depths[steps])
        self.translation.append(simulation.path.translations[steps])
        self.turn.append(simulation.path.rotations[steps])
        self.wrench.append(simulation.probe_wrench[steps])
        for step in steps:
            nodes, forces = simulation.contacts(int(step), loaded=contact == "loaded")
            self.nodes.append(nodes.astype(np.int64))
            self.forces.append(forces.astype(np.float64))

    def table(self, mesh_hash: str, displacement: AnyArray, *, discretisation: str = "") -> SampleTable:
        counts = [len(nodes) for nodes in self.nodes]

        def join(parts: list[AnyArray], *shape: int) -> AnyArray:
            return np.concatenate(parts) if parts else np.empty((0, *shape))

        return SampleTable(
            mesh_hash, join(self.position).astype(np.int64), join(self.rotation), join(self.depth),
            join(self.translation, 3), join(self.turn, 3, 3),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), join(self.nodes).astype(np.int64),
            join(self.forces, 3), join(self.wrench, 6), displacement, discretisation=discretisation,
        )


def table_of(simulations: Iterable[Simulation], *, contact: ContactRule = "loaded") -> SampleTable:
    """Samples of simulations in memory: every converged step in which a node carries a contact force.

    Raises:
        InputError: no simulation, or simulations of several meshes.
    """
    columns, fields, meshes = _Columns(), [], set()
    for simulation in simulations:
        steps = simulation.sample_steps()
        columns.add(simulation, steps, contact)
        fields.append(simulation.displacement[steps].astype(np.float32))
        meshes.add(simulation.mesh_hash)
    if len(meshes) != 1:
        raise InputError(
            "simulations", expected="at least one, all of one mesh", got=f"{len(meshes)} meshes",
            fix="keep meshes apart",
        )
    return columns.table(meshes.pop(), np.concatenate(fields))


def build_sample_table(
    store: SimulationStore, *, poses: Iterable[Pose] | None = None, contact: ContactRule = "loaded",
    memory_map: Path | str | None = None,
) -> SampleTable:
    """Samples of all finished simulations of a store, in the order of its poses, on all nodes of the mesh.

    Args:
        store: the simulations.
        poses: those of them that are wanted; None for all.
        contact: which nodes count as contact nodes. Widening the set makes every model better: figures made with
            different rules may not be compared.
        memory_map: a ``.npy`` file to write the displacement to, from which it is then read on demand; without it
            all is kept in memory (105 kB a sample on a mesh of 8,746 nodes).

    Raises:
        InputError: a pose whose data are truncated or altered, or no sample at all.
    """
    done, wanted = [], None if poses is None else set(poses)
    for pose in store.poses:
        if wanted is not None and pose not in wanted:
            continue
        status = store.status(pose)
        if status.reason.startswith("damaged"):
            store.load(pose)
        if status.state is PoseState.DONE:
            done.append((pose, status.contact_steps))
    total = sum(count for _, count in done)
    if not total:
        raise InputError(
            str(store.folder), expected="at least one sample (a converged step with contact)", got="none",
            fix="simulate more poses, or deeper",
        )
    n_nodes = store.mesh().n_nodes
    columns = _Columns()

    def fill(displacement: AnyArray) -> None:
        begin = 0
        for pose, count in track(done, "read simulations"):
            simulation = store.load(pose)
            steps = simulation.sample_steps()
            if len(steps) != count:
                raise InputError(
                    str(store.pose_folder(pose)), expected=f"{count} samples, as its status says",
                    got=str(len(steps)), fix="delete this folder and run 'mixpinn simulate' again",
                )
            columns.add(simulation, steps, contact)
            displacement[begin: begin + count] = simulation.displacement[steps]
            begin += count

    if memory_map is None:
        displacement = np.empty((total, n_nodes, 3), dtype=np.float32)
        fill(displacement)
        return columns.table(store.mesh_hash, displacement, discretisation=store.discretisation)
    path = Path(memory_map)
    _check_room(path, total * n_nodes * 12)
    with atomic_path(path) as temporary:
        mapped = np.lib.format.open_memmap(temporary, mode="w+", dtype=np.float32, shape=(total, n_nodes, 3))
        fill(mapped)
        mapped.flush()
        del mapped
    saved = np.load(path, mmap_mode="r", allow_pickle=False)
    return columns.table(store.mesh_hash, saved, discretisation=store.discretisation)


def _check_room(path: Path, size: int) -> None:
    """A memory map on a full disk ends the process; better to look first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(path.parent).free
    if path.suffix != ".npy" or free < size:
        raise InputError(
            str(path), expected=f"a .npy file and {size / 1e6:.0f} MB of room", got=f"{free / 1e6:.0f} MB free",
            fix="choose a .npy file on another disk",
        )
