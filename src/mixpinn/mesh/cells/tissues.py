"""The tissue of each cell by volume, so that layers thinner than a cell keep their share.

The label map is read at 64 places spread evenly in the cell; voxels of bones and outside of the body do not count. The
two tissues that fill most of the cell make its tissue: one of them alone, or a mixture in steps of a tenth
(`mixpinn.anatomy.mixture`), whose moduli are the means by volume (`mixpinn.fem.material.mixed`).
"""

import numpy as np

from mixpinn.anatomy.mixture import mixed_parts, mixture_name
from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.records.label_map import LabelMap
from mixpinn.records.tissue_mesh import TissueMesh

_STEPS = 10
"""A mixture is told in so many steps."""
_CHUNK = 20_000


def _places(count: int) -> FloatArray:
    """Barycentric coordinates of places that fill a tetrahedron evenly, shape (count, 4).

    Multiples of the powers of 1/g, g⁴ = g + 1, modulo one, fill a cube; sorted, their differences fill the simplex.
    """
    g = 1.2207440846057596
    cube = np.sort((np.arange(1, count + 1)[:, None] * g ** -np.arange(1.0, 4.0)) % 1.0, axis=1)
    return np.diff(cube, axis=1, prepend=0.0, append=1.0)


_PLACES = _places(64)


def cell_tissues(corners: FloatArray, label_map: LabelMap) -> tuple[AnyArray, tuple[str, ...]]:
    """Index of the tissue of each cell, int16, shape (m,), and the names of all tissues.

    Args:
        corners: of the cells [mm], shape (m, 4, 3).
        label_map: its soft tissues come first among the names, mixtures that occur after them. Cells without a voxel of
            soft tissue, as happens next to a curved surface, are the body's, which is the first.
    """
    names = label_map.soft_names
    if len(names) == 1:
        return np.zeros(len(corners), dtype=np.int16), names
    first, second, tenths = (np.empty(len(corners), dtype=np.int64) for _ in range(3))
    for start in range(0, len(corners), _CHUNK):
        part = slice(start, start + _CHUNK)
        counts = _counts(corners[part], label_map)
        order = np.argsort(-counts, axis=1, kind="stable")
        first[part], second[part] = order[:, 0], order[:, 1]
        most, next_most = np.take_along_axis(counts, order[:, :2], axis=1).T
        tenths[part] = np.rint(_STEPS * most / np.maximum(most + next_most, 1))
    pure = (tenths == _STEPS) | (tenths == 0)  # none of the places is soft: 0 of 0
    # A half of the one is a half of the other: the same mixture, whichever comes first.
    swapped = ~pure & (2 * tenths == _STEPS) & (first > second)
    first[swapped], second[swapped] = second[swapped], first[swapped]
    codes = np.where(pure, first, len(names) * (1 + first + len(names) * second) + len(names) ** 3 * tenths)
    kinds, example, tissue = np.unique(codes, return_index=True, return_inverse=True)
    mixed = kinds >= len(names)
    mixtures = tuple(
        mixture_name(names[first[i]], names[second[i]], tenths[i] / _STEPS) for i in example[mixed]
    )
    index = np.where(mixed, len(names) + np.cumsum(mixed) - 1, kinds)
    return index[tissue.ravel()].astype(np.int16), (*names, *mixtures)


def _counts(corners: FloatArray, label_map: LabelMap) -> AnyArray:
    """How many of the places in each cell lie in each soft tissue, shape (m, T)."""
    inverse = np.linalg.inv(label_map.affine)
    at = np.einsum("pk,mkd->mpd", _PLACES, corners) @ inverse[:3, :3].T + inverse[:3, 3]
    index = np.clip(np.rint(at).astype(np.int64), 0, np.array(label_map.labels.shape) - 1)
    label = label_map.labels[tuple(np.moveaxis(index, -1, 0))]
    return np.stack([(label == number).sum(axis=1) for number in range(1, len(label_map.soft_names) + 1)], axis=1)


def tissue_volumes(mesh: TissueMesh) -> dict[str, float]:
    """Volume of each tissue [mm³], mixtures by their shares."""
    volumes: dict[str, float] = {}
    for index, name in enumerate(mesh.tissue_names):
        volume = float(mesh.cell_volumes[mesh.tissue == index].sum())
        for part, share in mixed_parts(name):
            volumes[part] = volumes.get(part, 0.0) + share * volume
    return volumes


def tissue_table(mesh: TissueMesh, label_map: LabelMap) -> str:
    """The tissues' volumes in the mesh beside those of the label map, as Markdown; empty for a single tissue."""
    if len(label_map.soft_names) < 2:
        return ""
    voxel = float(abs(np.linalg.det(label_map.affine[:3, :3])))
    counts = np.bincount(label_map.labels.ravel(), minlength=len(label_map.soft_names) + 1)
    found = tissue_volumes(mesh)
    mixed = int((mesh.tissue >= len(label_map.soft_names)).sum())
    rows = [
        f"| {name} | {voxel * counts[number] / 1e6:.2f} | {found.get(name, 0.0) / 1e6:.2f} |"
        for number, name in enumerate(label_map.soft_names, start=1)
    ]
    return "\n".join([
        "", "| Tissue | Label map [l] | Mesh [l] |", "| --- | ---: | ---: |", *rows, "",
        f"{mixed} of {len(mesh.cells)} cells hold two tissues; their moduli are means by volume.", "",
    ])
