"""Simulation: one pose of the probe, pressed in step by step."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray
from mixpinn.base.bounded import require_memory
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path
from mixpinn.base.validated import ArraySpec
from mixpinn.records.probe import ProbePath


@dataclass(frozen=True, eq=False)
class Simulation:
    """All steps of one pose; s steps, n mesh nodes (vertices first, then midpoints of edges), K rigid parts.

    Attributes:
        mesh_hash: `TissueMesh.hash` of the mesh that was simulated.
        position_index: index of the probe position.
        rotation_deg: rotation of the probe about the pressing axis [degree].
        path: the probe's pose at each step.
        displacement: of every mesh node [mm], float32, shape (s, n, 3).
        contact_offsets: shape (s + 1,): step i's contacts are entries contact_offsets[i]:contact_offsets[i + 1].
        contact_nodes: mesh nodes within the alarm distance, shape (c,).
        contact_forces: force of the probe on each of them [N], zero where it is near but not touching, shape (c, 3).
        probe_wrench: force [N] and moment about the tip [N mm] of the tissue on the probe, shape (s, 6).
        part_rotation: rotation matrix of each rigid part, shape (s, K, 3, 3).
        part_translation: displacement of the centroid of each rigid part [mm], shape (s, K, 3).
        converged: whether the step met its residual tolerance, shape (s,).
        residual: relative residual at the end of the step, shape (s,).
        iterations: Newton iterations of the step, shape (s,).
        energy: elastic energy [N mm], shape (s,).
        min_jacobian: smallest det F over the cells, shape (s,).
        penetration: largest violation of the contact gap [mm], shape (s,).
        seconds: wall time of the step [s], shape (s,).
        part_wrench: force [N] and moment about the centroid [N mm] that are left unbalanced on each rigid part, shape
            (s, K, 6); None in stores that do not have it.
    """

    mesh_hash: str
    position_index: int
    rotation_deg: float
    path: ProbePath
    displacement: Float32Array
    contact_offsets: IntArray
    contact_nodes: IntArray
    contact_forces: FloatArray
    probe_wrench: FloatArray
    part_rotation: FloatArray
    part_translation: FloatArray
    converged: BoolArray
    residual: FloatArray
    iterations: IntArray
    energy: FloatArray
    min_jacobian: FloatArray
    penetration: FloatArray
    seconds: FloatArray
    part_wrench: FloatArray | None = None

    @property
    def n_steps(self) -> int:
        """Number of steps, failed ones included."""
        return len(self.path)

    def contacts(self, step: int, *, loaded: bool = True) -> tuple[IntArray, FloatArray]:
        """Contact nodes of a step and the force on each [N]; `loaded` keeps those that carry force only."""
        chosen = slice(int(self.contact_offsets[step]), int(self.contact_offsets[step + 1]))
        nodes, forces = self.contact_nodes[chosen], self.contact_forces[chosen]
        if loaded:
            carries = np.abs(forces).sum(axis=1) > 0.0
            nodes, forces = nodes[carries], forces[carries]
        return nodes, forces

    def sample_steps(self) -> IntArray:
        """Steps that are samples: converged, with at least one loaded contact node."""
        return np.array([
            step for step in range(self.n_steps) if self.converged[step] and len(self.contacts(step)[0])
        ], dtype=np.int64)

    def arrays(self) -> dict[str, AnyArray]:
        """Every array of the record by name, the path's flattened into it."""
        values: dict[str, AnyArray] = {
            field.name: getattr(self, field.name)
            for field in fields(self) if isinstance(getattr(self, field.name), np.ndarray)
        }
        values |= {
            "path_translations": self.path.translations, "path_rotations": self.path.rotations,
            "path_depths": self.path.depths,
        }
        return values

    def save(self, folder: Path | str) -> None:
        """Write a Zarr group of its own at `folder`, atomically."""
        import zarr

        with atomic_path(folder) as temporary:
            group = zarr.open_group(str(temporary), mode="w")
            group.attrs.update({
                "mesh_hash": self.mesh_hash, "position_index": int(self.position_index),
                "rotation_deg": float(self.rotation_deg),
            })
            for name, array in self.arrays().items():
                chunks = (1, *array.shape[1:]) if name == "displacement" else array.shape
                group.create_array(name, data=np.ascontiguousarray(array), chunks=tuple(max(1, c) for c in chunks))

    @staticmethod
    def load(folder: Path | str) -> "Simulation":
        """Read what `save` wrote.

        Raises:
            InputError: absent, truncated or of another layout.
        """
        import zarr

        try:
            group = zarr.open_group(str(folder), mode="r")
            found = {name: group[name] for name in group.array_keys()}
            _check_claims(found, str(folder))  # before anything is unpacked
            values = {name: np.asarray(array[...]) for name, array in found.items()}
            _check_values(values, str(folder))
            path = ProbePath(
                values.pop("path_translations"), values.pop("path_rotations"), values.pop("path_depths"),
            )
            return Simulation(
                mesh_hash=str(group.attrs["mesh_hash"]), position_index=int(group.attrs["position_index"]),
                rotation_deg=float(group.attrs["rotation_deg"]), path=path, **values,
            )
        except InputError:
            raise
        except Exception as error:
            text = " ".join(str(error).split())[:200]
            raise InputError(
                str(folder), expected="a complete simulation", got=f"{type(error).__name__}: {text}", fix=_REMAKE,
            ) from error


_REMAKE = "delete it and run 'mixpinn simulate' again: finished poses are kept"
_STEP = ArraySpec("number", ("steps",), finite=False)
"""One number a step, NaN where it is not known."""
_ARRAYS = {
    "path_translations": ArraySpec("number", ("steps", 3)), "path_rotations": ArraySpec("number", ("steps", 3, 3)),
    "path_depths": ArraySpec("number", ("steps",)),
    "displacement": ArraySpec("number", ("steps", "nodes", 3), finite=False),
    "contact_offsets": ArraySpec("index", ("offsets",), low=0),
    "contact_nodes": ArraySpec("index", ("contacts",), low=0),
    "contact_forces": ArraySpec("number", ("contacts", 3), finite=False),
    "probe_wrench": ArraySpec("number", ("steps", 6), finite=False),
    "part_rotation": ArraySpec("number", ("steps", "parts", 3, 3), finite=False),
    "part_translation": ArraySpec("number", ("steps", "parts", 3), finite=False),
    "converged": ArraySpec("flag", ("steps",)), "residual": _STEP,
    "iterations": ArraySpec("index", ("steps",), low=0), "energy": _STEP, "min_jacobian": _STEP, "penetration": _STEP,
    "seconds": _STEP, "part_wrench": ArraySpec("number", ("steps", "parts", 6), finite=False),
}
_OPTIONAL = ("part_wrench",)


def _check_claims(found: Mapping[str, Any], where: str) -> None:
    """Compare kinds and shapes that the arrays state with each other, and their sizes with the memory at hand."""
    absent = [name for name in _ARRAYS if name not in found and name not in _OPTIONAL]
    unknown = sorted(set(found) - set(_ARRAYS))
    if absent or unknown:
        raise InputError(
            where, expected="the arrays of a simulation",
            got=f"no {', '.join(absent)}" if absent else f"an array {unknown[0]!r}", fix=_REMAKE,
        )
    size = sum(math.prod(array.shape) * array.dtype.itemsize for array in found.values())
    require_memory(2 * size, what=where, holds="arrays", fix=_REMAKE)
    extents: dict[str, int] = {}
    for name, array in found.items():
        _ARRAYS[name].check_form(array.dtype, array.shape, f"{where}: {name}", extents=extents, remake=_REMAKE)
    if extents["offsets"] != extents["steps"] + 1:
        raise InputError(
            f"{where}: contact_offsets", expected=f"{extents['steps'] + 1} of them", got=str(extents["offsets"]),
            fix=_REMAKE,
        )


def _check_values(values: Mapping[str, AnyArray], where: str) -> None:
    for name, array in values.items():
        _ARRAYS[name].check(array, f"{where}: {name}", extents={}, remake=_REMAKE)
    offsets, nodes = values["contact_offsets"], values["contact_nodes"]
    n_nodes = values["displacement"].shape[1]
    if offsets[0] != 0 or offsets[-1] != len(nodes) or (np.diff(offsets) < 0).any():
        raise InputError(
            f"{where}: contact_offsets", expected=f"offsets that rise from 0 to {len(nodes)}", got="others",
            fix=_REMAKE,
        )
    solved = values["converged"].astype(bool)
    for name in ("displacement", "probe_wrench", "part_rotation", "part_translation"):
        ArraySpec("number", values[name][solved].shape).check(
            values[name][solved], f"{where}: {name} of steps that converged", extents={}, remake=_REMAKE,
        )
    if len(nodes) and nodes.max() >= n_nodes:
        raise InputError(
            f"{where}: contact_nodes", expected=f"nodes below {n_nodes}", got=str(nodes.max()), fix=_REMAKE,
        )
