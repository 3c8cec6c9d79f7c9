"""Sample: one loaded step; SampleTable: all samples of a data set on one mesh."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray


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
    """N samples on one mesh of n nodes.

    Attributes:
        mesh_hash: `TissueMesh.hash` of their mesh.
        position_index, rotation_deg, depth: of each sample, shape (N,).
        probe_translation, probe_rotation: pose of the probe at each sample, shapes (N, 3) [mm] and (N, 3, 3).
        contact_offsets: shape (N + 1,), into `contact_nodes`.
        contact_nodes: shape (c,).
        contact_forces: force on each contact node [N], shape (c, 3).
        probe_wrench: force [N] and moment about the tip [N mm] of the tissue on the probe, shape (N, 6).
        displacement: of every mesh node [mm], float32, shape (N, n, 3); may be memory-mapped.
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

    def __len__(self) -> int:
        return len(self.depth)

    def __getitem__(self, index: int) -> Sample:
        nodes = self.contacts(index)
        field = self.displacement[index]
        return Sample(
            int(self.position_index[index]), float(self.rotation_deg[index]), float(self.depth[index]),
            nodes, field[nodes].astype(np.float64), field,
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
        )

    def at_positions(self, positions: AnyArray) -> "SampleTable":
        """The samples whose position index is in `positions`."""
        mask: BoolArray = np.isin(self.position_index, positions)
        return self.select(mask)

    def contact_field(self, index: int) -> Float32Array:
        """Displacement of the contact nodes, zero elsewhere [mm], shape (n, 3): the models' input."""
        field = np.zeros_like(self.displacement[index])
        nodes = self.contacts(index)
        field[nodes] = self.displacement[index][nodes]
        return field
