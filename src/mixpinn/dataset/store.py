"""Store: the simulations of one mesh, one Zarr group a pose, so that writers never share a file."""

import shutil
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays, read_json, write_json
from mixpinn.base.manifest import Artefact
from mixpinn.base.validated import load_record
from mixpinn.dataset.protocol import Pose, Protocol
from mixpinn.dataset.status import PoseState, PoseStatus, content_hash, folder_sizes, status_of
from mixpinn.fem.contact.model import ContactConfig
from mixpinn.fem.local_refinement import LocalRefinement
from mixpinn.fem.material.hyperelastic import Material
from mixpinn.fem.scene_record import (
    recorded_contact,
    recorded_materials,
    recorded_refinement,
    recorded_restraints,
    scene_hash,
)
from mixpinn.physics.joint_system import Joint
from mixpinn.physics.restraints import Restraints
from mixpinn.records import MESH_FILE, Probe, Simulation, TissueMesh
from mixpinn.records.answer import discretisation_of

RECORD = "store.json"
PROBE = "probe.stl"
STATUS = "status"
STORE = Artefact("store of simulations", 1, "put the file back from a copy, or simulate into another folder")


@dataclass(frozen=True)
class _Record:
    """What ``store.json`` holds."""

    format: Literal["mixpinn simulations 1"]
    mesh_hash: str
    protocol: Protocol
    positions: tuple[tuple[float, float, float], ...]
    poses: tuple[Pose, ...]
    scene: dict[str, Any]
    discretisation: str = ""


@dataclass(frozen=True, eq=False)
class SimulationStore:
    """A folder of simulations::

        store.json              mesh hash and discretisation, protocol, positions, poses, scene
        mesh.vtu                the mesh
        probe.stl               the probe, where it is known
        manifest.json           sizes and hashes of these three
        pose_PPP_RRR/           one `Simulation`
        status/pose_PPP_RRR.json
        summary.json            totals, see `mixpinn.dataset.summarise`

    A pose counts as done when its status says so, which is written after its data; the status carries the size of
    each file and a hash of the arrays, so that a truncated or altered group is found out and simulated again.

    Attributes:
        folder: where it lies.
        mesh_hash: `TissueMesh.hash` of the only mesh whose simulations it takes.
        protocol: how the poses were made.
        positions: listed probe positions [mm], shape (p, 3).
        poses: all that belong to it, in order.
        scene: what else the results depend on (materials, contact, solver, probe): `mixpinn.fem.scene_record`.
        discretisation: elements and mesh in words (`mixpinn.records.answer.discretisation_of`).
    """

    folder: Path
    mesh_hash: str
    protocol: Protocol
    positions: FloatArray
    poses: tuple[Pose, ...]
    scene: Mapping[str, Any]
    discretisation: str

    @staticmethod
    def create(
        folder: Path | str, mesh: TissueMesh, *, protocol: Protocol, positions: FloatArray, poses: tuple[Pose, ...],
        scene: Mapping[str, Any] | None = None, probe: Probe | None = None,
    ) -> "SimulationStore":
        """Begin a store, or continue the one that lies there if it was begun with the same settings.

        Raises:
            InputError: the folder holds a store of another mesh or with other settings, or two poses of one name.
        """
        folder = Path(folder)
        names = [pose.name for pose in poses]
        if len(set(names)) < len(names):
            raise InputError(
                str(folder), expected="poses of different names", got="two of one name", fix="drop one of them",
            )
        store = SimulationStore(
            folder, mesh.hash(), protocol, np.asarray(positions, dtype=np.float64), tuple(poses), dict(scene or {}),
            discretisation_of(mesh),
        )
        record = store._record()
        if (folder / RECORD).exists():
            before = read_json(folder / RECORD)
            known = before if isinstance(before, dict) else {}
            changed = [key for key, value in record.items() if known.get(key) != value]
            if changed:
                meshes = f" (of {_made_on(known)} instead of {discretisation_of(mesh)})"
                other = meshes if "mesh_hash" in changed else ""
                raise InputError(
                    str(folder), expected="an empty folder or a store begun with the same settings",
                    got=f"a store with other {', '.join(changed)}{other}",
                    fix="choose another folder or delete this one",
                )
            if STORE.is_sealed(folder):
                return store
            # Whoever began it was stopped before all was written.
        mesh.save(folder / MESH_FILE)
        if probe is not None:
            probe.save(folder / PROBE)
        write_json(folder / RECORD, {**record, "discretisation": store.discretisation})
        STORE.seal(folder, [RECORD, MESH_FILE, *([] if probe is None else [PROBE])])
        return store

    @staticmethod
    def open(folder: Path | str, *, mesh: TissueMesh | None = None) -> "SimulationStore":
        """Open an existing store.

        Args:
            folder: where it lies.
            mesh: refuse a store of any other mesh.

        Raises:
            InputError: no store, a damaged one, or one of another mesh.
        """
        folder = Path(folder)
        if not (folder / RECORD).is_file():
            raise InputError(
                str(folder), expected=f"a store of simulations ({RECORD})", got="none",
                fix="run 'mixpinn simulate' first",
            )
        STORE.check(folder, RECORD)
        record = load_record(_Record, folder / RECORD, remake=STORE.remake)
        positions = np.array(record.positions, dtype=np.float64).reshape(-1, 3)
        store = SimulationStore(
            folder, record.mesh_hash, record.protocol, positions, record.poses, record.scene, _made_on(asdict(record)),
        )
        if mesh is not None and mesh.hash() != store.mesh_hash:
            raise InputError(
                str(folder), expected=f"simulations of {discretisation_of(mesh)}",
                got=f"those of {store.discretisation}",
                fix=f"use the mesh that the store was made with (its {MESH_FILE})",
            )
        return store

    @property
    def scene_hash(self) -> str:
        """Identity of the scene that was simulated: that of `mixpinn.fem.Scene`."""
        return scene_hash(self.scene, self.mesh_hash)

    @property
    def identity(self) -> str:
        """Identity of all settings that the results depend on: the scene, the protocol and the poses."""
        text = repr(sorted(self._record().items())).encode()
        return hash_arrays(np.frombuffer(text, dtype=np.uint8))

    def materials(self) -> tuple[Material, ...]:
        """The material of each tissue of the mesh that the simulations were made with.

        Raises:
            InputError: not recorded, or a class of the user's own.
        """
        return recorded_materials(self.scene, str(self.folder))

    def restraints(self) -> Restraints:
        """The joints and foundations that the simulations were made with; nothing where there were none.

        Raises:
            InputError: a law of the user's own.
        """
        return recorded_restraints(self.scene, str(self.folder))

    def joints(self) -> tuple[Joint, ...]:
        """The joints among them."""
        return self.restraints().joints

    def contact(self) -> ContactConfig:
        """How the probe touched the skin in the simulations.

        Raises:
            InputError: not recorded.
        """
        return recorded_contact(self.scene, str(self.folder))

    def refinement(self) -> LocalRefinement | None:
        """How cells were refined under the probe; None where they were not."""
        return recorded_refinement(self.scene)

    def probe(self) -> Probe | None:
        """The probe of the simulations; None where it was not recorded.

        Raises:
            InputError: its file is absent or was altered.
        """
        if not STORE.lists(self.folder, PROBE):
            return None
        STORE.check(self.folder, PROBE)
        return Probe.load(self.folder / PROBE)

    def mesh(self) -> TissueMesh:
        """The mesh of the store.

        Raises:
            InputError: absent or altered.
        """
        STORE.check(self.folder, MESH_FILE)
        mesh = TissueMesh.load(self.folder / MESH_FILE)
        if mesh.hash() != self.mesh_hash:
            raise InputError(
                str(self.folder / MESH_FILE), expected=f"the mesh {self.mesh_hash}", got=f"the mesh {mesh.hash()}",
                fix="put the mesh.vtu back that these simulations were made on, or simulate again in another folder",
            )
        return mesh

    def pose_folder(self, pose: Pose) -> Path:
        """Where the pose's group lies."""
        return self.folder / pose.name

    def status(self, pose: Pose) -> PoseStatus:
        """What became of `pose`; a group that is incomplete or altered in size counts as missing."""
        path = self.folder / STATUS / f"{pose.name}.json"
        if not path.is_file():
            return PoseStatus(pose.name, PoseState.MISSING, reason="not simulated")
        try:
            status = PoseStatus.load(path)
        except InputError as error:
            return PoseStatus(pose.name, PoseState.MISSING, reason=f"damaged status: {error.got}")
        if status.state is PoseState.DONE and folder_sizes(self.pose_folder(pose)) != status.files:
            return PoseStatus(pose.name, PoseState.MISSING, reason="damaged: files absent or truncated")
        return status

    def statuses(self) -> list[PoseStatus]:
        """Status of every pose, in order."""
        return [self.status(pose) for pose in self.poses]

    @property
    def is_complete(self) -> bool:
        """Whether no pose is missing."""
        return all(status.state is not PoseState.MISSING for status in self.statuses())

    def save(self, pose: Pose, simulation: Simulation, *, attempts: int = 1) -> PoseStatus:
        """Store the result of a pose in place of what was there.

        Raises:
            InputError: a simulation of another mesh or pose, or no room to write.
        """
        same_pose = simulation.position_index == pose.position_index and simulation.rotation_deg == pose.rotation_deg
        if simulation.mesh_hash != self.mesh_hash or not same_pose:
            raise InputError(
                str(self.pose_folder(pose)), expected=f"{pose.name} on the mesh {self.mesh_hash}",
                got=f"position {simulation.position_index} at {simulation.rotation_deg}° on {simulation.mesh_hash}",
                fix="simulate on the mesh of this store (its mesh.vtu), or begin another store for the other mesh",
            )
        self.discard(pose)
        simulation.save(self.pose_folder(pose))
        status = status_of(pose.name, simulation, folder=self.pose_folder(pose), attempts=attempts)
        status.save(self.folder / STATUS / f"{pose.name}.json")
        return status

    def fail(self, pose: Pose, reason: str, *, attempts: int = 1) -> PoseStatus:
        """Record that a pose has no result, and why."""
        self.discard(pose)
        status = PoseStatus(pose.name, PoseState.FAILED, reason=reason, attempts=attempts)
        status.save(self.folder / STATUS / f"{pose.name}.json")
        return status

    def discard(self, pose: Pose) -> None:
        """Delete what is stored of a pose, status first, so that no moment shows a status without its data."""
        (self.folder / STATUS / f"{pose.name}.json").unlink(missing_ok=True)
        shutil.rmtree(self.pose_folder(pose), ignore_errors=True)

    def clear_unfinished(self) -> None:
        """Delete temporary files that killed writers left; only while nothing writes."""
        for folder in (self.folder, self.folder / STATUS):
            for left in folder.glob(".writing-*"):
                shutil.rmtree(left, ignore_errors=True)

    def load(self, pose: Pose) -> Simulation:
        """Read the simulation of a pose and check it against its hash.

        Raises:
            InputError: not simulated, failed, truncated or altered.
        """
        status = self.status(pose)
        if status.state is not PoseState.DONE:
            raise InputError(
                str(self.pose_folder(pose)), expected="a finished simulation", got=f"{status.state} ({status.reason})",
                fix="run 'mixpinn simulate' again: finished poses are kept",
            )
        simulation = Simulation.load(self.pose_folder(pose))
        of_pose = (simulation.position_index, simulation.rotation_deg) == (pose.position_index, pose.rotation_deg)
        if (
            content_hash(simulation) != status.content_hash or simulation.mesh_hash != self.mesh_hash or not of_pose
        ):
            raise InputError(
                str(self.pose_folder(pose)), expected="the data that were saved", got="altered data",
                fix="delete this folder and run 'mixpinn simulate' again: finished poses are kept",
            )
        return simulation

    def __iter__(self) -> Iterator[Simulation]:
        """All finished simulations in the order of the poses."""
        for pose in self.poses:
            if self.status(pose).state is PoseState.DONE:
                yield self.load(pose)

    def _record(self) -> dict[str, Any]:
        """What identifies the store, as plain values that survive a round trip through JSON."""
        return {
            "format": "mixpinn simulations 1", "mesh_hash": self.mesh_hash,
            "protocol": {
                key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self.protocol).items()
            },
            "positions": self.positions.tolist(),
            "poses": [{**asdict(pose), "position": list(pose.position)} for pose in self.poses],
            "scene": dict(self.scene),
        }


def _made_on(record: Mapping[str, Any]) -> str:
    """Discretisation of a store from its record, or its mesh alone where no more is known."""
    return str(record.get("discretisation") or f"mesh {record.get('mesh_hash')}")
