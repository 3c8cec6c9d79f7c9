"""SOFA in: recordings of SOFA scenes become simulations."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.array_file import read_npz
from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.base.validated import ArraySpec
from mixpinn.geometry.rigid_fit import fit_rotation
from mixpinn.geometry.rotations import rotation_about_y
from mixpinn.records import ProbePath, Simulation, TissueMesh

MICROMETRE = 1e-3
"""Displacements are recorded as 16-bit integers in µm: ± 32.7 mm."""
MILLINEWTON = 1e-3
"""Forces are recorded in mN."""
REQUIRED = (
    "displacement_um", "contact_offsets", "contact_nodes", "contact_forces_mN", "contact_probe_position",
    "rotation_deg", "position_index",
)
_CONTACTS = {
    "contact_nodes": ArraySpec("index", ("contacts",), low=0),
    "contact_forces_mN": ArraySpec("number", ("contacts", 3)),
    "rotation_deg": ArraySpec("number", ()), "position_index": ArraySpec("index", (), low=0),
}
_PATH = _CONTACTS | {
    "displacement_um": ArraySpec("number", ("steps", "nodes", 3)), "contact_offsets": ArraySpec("index", ("offsets",)),
    "contact_probe_position": ArraySpec("number", ("steps", 3), finite=False),
    "depths": ArraySpec("number", ("steps",)), "probe_rotation": ArraySpec("number", ("steps", 3, 3)),
    "step_cpu_ms": ArraySpec("number", ("steps",), finite=False),
}
_STATIC = _CONTACTS | {
    "displacement": ArraySpec("number", ("nodes", 3)), "contact_probe_y": ArraySpec("number", ()),
}
"""What the arrays of recordings must be, where they are there."""
FIRST_DEPTH = -7.0
"""Depth of the first recorded step [mm] where a recording does not say: step s = 1 … 28 has depth s − 8."""


def read_sofa_recording(path: Path | str, mesh: TissueMesh) -> Simulation:
    """Read one ``pose_PPP_RRR.npz``.

    What a recording has not, a simulation must: the rotation and translation of each rigid part are fitted to its
    nodes; the wrench on the probe is minus the sum of the contact forces, with their moment about the tip; every
    step counts as converged, since SOFA solves one linearised step a frame and states no residual. Residual,
    energy, smallest det F and penetration are unknown (NaN).

    The path's translation is the tip of SOFA's collision mesh, which is what the contact of the step saw; it
    trails the step's depth by one step where the recording was made with a probe body that drags its collision mesh
    behind it. Its rotation is about +y unless the recording holds ``probe_rotation``.

    Raises:
        InputError: unreadable, incomplete, or made on another mesh.
    """
    path = Path(path)
    values = _read(path, REQUIRED)
    _check(path, values, _PATH)
    displacement = (values["displacement_um"].astype(np.float32) * np.float32(MICROMETRE)).astype(np.float32)
    _check_nodes(path, displacement.shape[1], mesh)
    steps = len(displacement)
    rotation_deg = float(values["rotation_deg"])
    tips = values["contact_probe_position"].astype(np.float64)
    depths = values.get("depths", FIRST_DEPTH + np.arange(steps)).astype(np.float64)
    rotation = values.get("probe_rotation", np.tile(rotation_about_y(rotation_deg), (steps, 1, 1))).astype(np.float64)
    offsets = values["contact_offsets"].astype(np.int64)
    nodes = values["contact_nodes"].astype(np.int64)
    forces = values["contact_forces_mN"].astype(np.float64) * MILLINEWTON
    consistent = (
        len(offsets) == steps + 1 and offsets[0] == 0 and offsets[-1] == len(nodes) == len(forces)
        and (np.diff(offsets) >= 0).all() and tips.shape == (steps, 3)
        and (not len(nodes) or (nodes.min() >= 0 and nodes.max() < mesh.n_points))
    )
    if not consistent:
        raise InputError(
            str(path), expected="contact lists that fit the steps and the mesh", got="lists that do not",
            fix="record the pose again",
        )
    return _simulation(
        mesh, int(values["position_index"]), rotation_deg, ProbePath(tips, rotation, depths), displacement,
        (offsets, nodes, forces), seconds=values.get("step_cpu_ms", np.full(steps, np.nan)).astype(np.float64) / 1000.0,
    )


def read_sofa_static(path: Path | str, mesh: TissueMesh, positions: FloatArray) -> Simulation:
    """Read one ``static/pose_PPP_RRR.npz``: a converged static field, as a simulation of one step.

    Args:
        path: the recording.
        mesh: its mesh.
        positions: listed probe positions [mm], shape (p, 3): the recording holds only the height of the tip.

    Raises:
        InputError: unreadable, incomplete, or made on another mesh.
    """
    path = Path(path)
    values = _read(path, (
        "displacement", "contact_nodes", "contact_forces_mN", "contact_probe_y", "rotation_deg", "position_index",
    ))
    _check(path, values, _STATIC)
    displacement = values["displacement"].astype(np.float32)[None]
    _check_nodes(path, displacement.shape[1], mesh)
    index, rotation_deg = int(values["position_index"]), float(values["rotation_deg"])
    if index >= len(positions):
        raise InputError(
            str(path), expected=f"a position below {len(positions)}", got=str(index),
            fix="give the positions that the recordings were made at",
        )
    tip = np.array([positions[index, 0], float(values["contact_probe_y"]), positions[index, 2]])
    # The collision mesh is one step of 1 mm behind the depth.
    depth = positions[index, 1] - tip[1] + 1.0
    nodes = values["contact_nodes"].astype(np.int64)
    contacts = (np.array([0, len(nodes)]), nodes, values["contact_forces_mN"].astype(np.float64) * MILLINEWTON)
    poses = ProbePath(tip[None], rotation_about_y(rotation_deg)[None], np.array([depth]))
    return _simulation(mesh, index, rotation_deg, poses, displacement, contacts, seconds=np.full(1, np.nan))


def import_sofa(
    folder: Path | str, mesh: TissueMesh, *, names: Sequence[str] | None = None,
) -> Iterator[Simulation]:
    """Read all recordings ``pose_PPP_RRR.npz`` of a folder, one after the other, by name.

    Args:
        folder: where they lie.
        mesh: the mesh that they were made on.
        names: file names without suffix, to read only these.

    Raises:
        InputError: no recording, or one that cannot be used.
    """
    folder = Path(folder)
    files = sorted(folder.glob("pose_*.npz")) if names is None else [folder / f"{name}.npz" for name in names]
    if not files:
        raise InputError(str(folder), expected="recordings pose_PPP_RRR.npz", got="none", fix="check the folder")
    for path in track(files, "read SOFA recordings"):
        yield read_sofa_recording(path, mesh)


def _simulation(
    mesh: TissueMesh, position_index: int, rotation_deg: float, path: ProbePath, displacement: AnyArray,
    contacts: tuple[IntArray, IntArray, FloatArray], *, seconds: FloatArray,
) -> Simulation:
    offsets, nodes, forces = contacts
    steps, parts = len(displacement), mesh.n_parts
    rotations = np.tile(np.eye(3), (steps, parts, 1, 1))
    translations = np.zeros((steps, parts, 3))
    for k in range(1, parts + 1):
        members = mesh.part_nodes(k)
        moved = displacement[:, members].astype(np.float64)
        translations[:, k - 1] = moved.mean(axis=1)
        for step in range(steps):
            if moved[step].any():
                rotations[step, k - 1] = fit_rotation(mesh.points[members], mesh.points[members] + moved[step])
    wrench = np.zeros((steps, 6))
    for step in range(steps):
        chosen = slice(int(offsets[step]), int(offsets[step + 1]))
        arms = mesh.points[nodes[chosen]] + displacement[step][nodes[chosen]] - path.translations[step]
        # Action and reaction: f = −Σ fᵢ, m = −Σ (xᵢ − tip) × fᵢ with fᵢ the force of the probe on node i.
        wrench[step, :3] = -forces[chosen].sum(axis=0)
        wrench[step, 3:] = -np.cross(arms, forces[chosen]).sum(axis=0)
    unknown = np.full(steps, np.nan)
    return Simulation(
        mesh_hash=mesh.hash(), position_index=position_index, rotation_deg=rotation_deg, path=path,
        displacement=displacement, contact_offsets=offsets, contact_nodes=nodes, contact_forces=forces,
        probe_wrench=wrench, part_rotation=rotations, part_translation=translations,
        converged=np.ones(steps, dtype=bool), residual=unknown, iterations=np.ones(steps, dtype=np.int64),
        energy=unknown, min_jacobian=unknown, penetration=unknown, seconds=seconds,
    )


def _read(path: Path, required: Sequence[str]) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(str(path), expected="a SOFA recording (.npz)", got="no such file", fix="check the path")
    try:
        values: dict[str, Any] = {**read_npz(path)}
    except (OSError, ValueError) as error:
        raise InputError(
            str(path), expected="a readable SOFA recording (.npz)", got=str(error), fix="copy or record the file again",
        ) from error
    absent = [name for name in required if name not in values]
    if absent:
        raise InputError(
            str(path), expected="the arrays " + ", ".join(required), got=f"no {', '.join(absent)}",
            fix="record the pose with the exported scene",
        )
    return values


def _check(path: Path, values: dict[str, Any], specs: Mapping[str, ArraySpec]) -> None:
    extents: dict[str, int] = {}
    for name in specs.keys() & values.keys():
        array = np.squeeze(values[name]) if not specs[name].shape else values[name]
        specs[name].check(array, f"{path}: {name}", extents=extents, remake="copy or record the file again")
        values[name] = array


def _check_nodes(path: Path, count: int, mesh: TissueMesh) -> None:
    if count != mesh.n_points:
        raise InputError(
            str(path), expected=f"displacements of {mesh.n_points} nodes", got=f"of {count}",
            fix="give the mesh that the recording was made on",
        )
