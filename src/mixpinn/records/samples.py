"""Sample: one loaded step; SampleTable: all samples of a data set on one mesh."""

from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path, write_json
from mixpinn.base.manifest import Artefact
from mixpinn.base.validated import ArraySpec, load_arrays, load_record

_ABOUT = "samples.json"
_REMAKE = "delete the folder and give the command again"
SAMPLE_TABLE = Artefact("sample table", 1, _REMAKE)
_ARRAYS = {
    "position_index": ArraySpec("index", ("samples",), low=0), "rotation_deg": ArraySpec("number", ("samples",)),
    "depth": ArraySpec("number", ("samples",)), "probe_translation": ArraySpec("number", ("samples", 3)),
    "probe_rotation": ArraySpec("number", ("samples", 3, 3)), "contact_offsets": ArraySpec("index", ("offsets",)),
    "contact_nodes": ArraySpec("index", ("contacts",), low=0),
    "contact_forces": ArraySpec("number", ("contacts", 3)), "probe_wrench": ArraySpec("number", ("samples", 6)),
    "displacement": ArraySpec("number", ("samples", "nodes", 3)),
    "contact_error": ArraySpec("number", ("contacts", 3)),
}
FILES = (_ABOUT, *(f"{name}.npy" for name in _ARRAYS))
"""Of a table's folder, as far as they are there."""


@dataclass(frozen=True)
class _About:
    """What ``samples.json`` holds."""

    mesh_hash: str
    samples: int
    discretisation: str = ""


@dataclass(frozen=True, eq=False)
class Sample:
    """A step in which at least one mesh node carries a contact force.

    Attributes:
        position_index: index of the probe position.
        rotation_deg: rotation of the probe about the pressing axis [degree].
        depth: indentation depth [mm].
        contact_nodes: shape (c,).
        contact_displacement: displacement of the contact nodes [mm], shape (c, 3).
        displacement: of every mesh node [mm], float32, shape (n, 3).
    """

    position_index: int
    rotation_deg: float
    depth: float
    contact_nodes: IntArray
    contact_displacement: FloatArray
    displacement: Float32Array


@dataclass(frozen=True, eq=False)
class SampleTable:
    """N samples on one mesh of n nodes: its vertices, followed by the midpoints of its edges where its order is 2.

    Attributes:
        mesh_hash: `TissueMesh.hash` of their mesh.
        position_index, rotation_deg, depth: of each sample, shape (N,).
        probe_translation, probe_rotation: pose of the probe at each sample, shapes (N, 3) [mm] and (N, 3, 3).
        contact_offsets: shape (N + 1,), into `contact_nodes`.
        contact_nodes: shape (c,).
        contact_forces: force on each contact node [N], shape (c, 3).
        probe_wrench: force [N] and moment about the tip [N mm] of the tissue on the probe, shape (N, 6).
        displacement: of every mesh node [mm], float32, shape (N, n, 3); may be memory-mapped.
        contact_error: by how much the contact displacement that a model is told differs from the true one [mm], shape
            (c, 3); None where a model is told the truth.
        discretisation: elements and mesh in words; empty where an older version wrote the table.
    """

    mesh_hash: str
    position_index: IntArray
    rotation_deg: FloatArray
    depth: FloatArray
    probe_translation: FloatArray
    probe_rotation: FloatArray
    contact_offsets: IntArray
    contact_nodes: IntArray
    contact_forces: FloatArray
    probe_wrench: FloatArray
    displacement: Float32Array
    contact_error: FloatArray | None = None
    discretisation: str = ""

    @property
    def made_on(self) -> str:
        """The discretisation, or the mesh alone where no more is known."""
        return self.discretisation or f"mesh {self.mesh_hash}"

    def __len__(self) -> int:
        return len(self.depth)

    def __getitem__(self, index: int) -> Sample:
        nodes = self.contacts(index)
        field = self.displacement[index]
        return Sample(
            int(self.position_index[index]), float(self.rotation_deg[index]), float(self.depth[index]),
            nodes, self._told(index).astype(np.float64), field,
        )

    def contacts(self, index: int) -> IntArray:
        """Contact nodes of one sample."""
        return self.contact_nodes[self.contact_offsets[index]: self.contact_offsets[index + 1]]

    def select(self, chosen: AnyArray) -> "SampleTable":
        """The samples at indices (or where the mask) `chosen`, in that order."""
        index = np.arange(len(self))[chosen]
        counts = np.diff(self.contact_offsets)[index]
        entries = np.concatenate([
            np.arange(self.contact_offsets[i], self.contact_offsets[i + 1]) for i in index
        ] or [np.empty(0, dtype=np.int64)]).astype(np.int64)
        return SampleTable(
            self.mesh_hash, self.position_index[index], self.rotation_deg[index], self.depth[index],
            self.probe_translation[index], self.probe_rotation[index],
            np.concatenate([[0], np.cumsum(counts)]), self.contact_nodes[entries], self.contact_forces[entries],
            self.probe_wrench[index], self.displacement[index],
            None if self.contact_error is None else self.contact_error[entries], self.discretisation,
        )

    def on_vertices(self, n_points: int) -> "SampleTable":
        """The samples as seen at the first `n_points` nodes, the vertices: contact nodes are the vertices among them.

        What networks on the graph of the mesh learn from; all of the table where the cells are linear.
        """
        if self.displacement.shape[1] == n_points:
            return self
        kept = self.contact_nodes < n_points
        before = np.concatenate([[0], np.cumsum(kept)]).astype(np.int64)
        return replace(
            self, contact_offsets=before[self.contact_offsets], contact_nodes=self.contact_nodes[kept],
            contact_forces=self.contact_forces[kept], displacement=self.displacement[:, :n_points],
            contact_error=None if self.contact_error is None else self.contact_error[kept],
        )

    def at_positions(self, positions: AnyArray) -> "SampleTable":
        """The samples whose position index is in `positions`."""
        mask: BoolArray = np.isin(self.position_index, positions)
        return self.select(mask)

    def contact(self, index: int) -> tuple[IntArray, Float32Array]:
        """Contact nodes of one sample, shape (c,), and the displacement of each as a model is told it [mm], (c, 3)."""
        return self.contacts(index), self._told(index)

    def contact_field(self, index: int) -> Float32Array:
        """Displacement of the contact nodes, zero elsewhere [mm], shape (n, 3): what networks read."""
        field = np.zeros_like(self.displacement[index])
        field[self.contacts(index)] = self._told(index)
        return field

    def _told(self, index: int) -> Float32Array:
        """Displacement of the contact nodes as a model is told it [mm], shape (c, 3)."""
        told: Float32Array = self.displacement[index][self.contacts(index)]
        if self.contact_error is not None:
            entries = slice(int(self.contact_offsets[index]), int(self.contact_offsets[index + 1]))
            told = (told + self.contact_error[entries]).astype(np.float32)
        return told

    def save(self, folder: Path | str) -> None:
        """Write a folder with one ``.npy`` an array, atomically."""
        with atomic_path(folder) as temporary:
            temporary.mkdir()
            for field in fields(self):
                value = getattr(self, field.name)
                if isinstance(value, np.ndarray):
                    np.save(temporary / f"{field.name}.npy", value, allow_pickle=False)
            write_json(temporary / _ABOUT, {
                "mesh_hash": self.mesh_hash, "samples": len(self), "discretisation": self.discretisation,
            })
            SAMPLE_TABLE.seal(temporary, sorted(path.name for path in temporary.iterdir()))

    @staticmethod
    def load(folder: Path | str) -> "SampleTable":
        """Read what `save` wrote; the displacement is memory-mapped.

        Raises:
            InputError: absent, damaged or altered.
        """
        SAMPLE_TABLE.check(folder)
        about = load_record(_About, Path(folder) / _ABOUT, remake=_REMAKE)
        arrays = load_arrays(
            folder, _ARRAYS, remake=_REMAKE, mapped=("displacement",), optional=("contact_error",),
            extents={"samples": about.samples, "offsets": about.samples + 1},
        )
        offsets, nodes = arrays["contact_offsets"], arrays["contact_nodes"]
        if offsets[0] != 0 or offsets[-1] != len(nodes) or (np.diff(offsets) < 0).any():
            raise InputError(
                str(Path(folder) / "contact_offsets.npy"), expected=f"offsets that rise from 0 to {len(nodes)}",
                got="others", fix=_REMAKE,
            )
        if len(nodes) and nodes.max() >= arrays["displacement"].shape[1]:
            raise InputError(
                str(Path(folder) / "contact_nodes.npy"), expected=f"nodes below {arrays['displacement'].shape[1]}",
                got=str(nodes.max()), fix=_REMAKE,
            )
        return SampleTable(mesh_hash=about.mesh_hash, discretisation=about.discretisation, **arrays)
