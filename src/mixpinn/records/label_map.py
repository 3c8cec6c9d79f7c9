"""LabelMap: which voxel belongs to which structure, in the world frame."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path, hash_arrays, write_json
from mixpinn.base.manifest import Artefact
from mixpinn.base.validated import ArraySpec, load_record
from mixpinn.records.voxels import read_labels

SCANNER_TO_WORLD = np.diag([1.0, -1.0, -1.0, 1.0])
"""RAS scanner axes turned 180 degrees about x: world (x, y, z) = (right, posterior, caudal)."""
_REMAKE = "run 'mixpinn anatomy' again"
_Row = tuple[float, float, float, float]


@dataclass(frozen=True)
class _About:
    """What ``NAME.json`` holds beside a label map."""

    affine: tuple[_Row, _Row, _Row, _Row]
    world_to_scanner: tuple[_Row, _Row, _Row, _Row]
    soft_names: tuple[str, ...]
    rigid_names: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    cut_names: tuple[str, ...] = ()
    target_names: tuple[str, ...] = ()
    phantom: bool = False


@dataclass(frozen=True, eq=False)
class LabelMap:
    """Structures of one anatomy on one voxel grid.

    Attributes:
        labels: uint8, shape (ni, nj, nk). 0 outside; 1 … S the soft tissues; S+1 … S+K the rigid parts.
        affine: voxel index to world frame [mm], shape (4, 4). The origin is the centre of the body's bounding
            box; x = patient right, y = posterior, z = caudal.
        world_to_scanner: world frame [mm] to the scanner's RAS frame [mm], shape (4, 4).
        soft_names: names of labels 1 … S; the first is the body.
        rigid_names: names of labels S+1 … S+K, ordered cranial to caudal.
        doubts: what was noticed while it was made (see `mixpinn.records.doubts`).
        cut_names: rigid parts of which some lies outside the image.
        target_names: rigid parts that are pressed on; empty where all are.
        phantom: whether it is no patient's, but built.
    """

    labels: AnyArray
    affine: FloatArray
    world_to_scanner: FloatArray
    soft_names: tuple[str, ...]
    rigid_names: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    cut_names: tuple[str, ...] = ()
    target_names: tuple[str, ...] = ()
    phantom: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of labels 1, 2, …"""
        return self.soft_names + self.rigid_names

    @property
    def voxel_volume(self) -> float:
        """Volume of one voxel [mm³]."""
        return abs(float(np.linalg.det(self.affine[:3, :3])))

    def mask(self, name: str) -> AnyArray:
        """Boolean mask of structure `name`, shape (ni, nj, nk)."""
        mask: AnyArray = self.labels == self.names.index(name) + 1
        return mask

    def hash(self) -> str:
        """Identity of the content."""
        named = [np.frombuffer(repr(names).encode(), dtype=np.uint8) for names in (
            self.cut_names, self.target_names,
        ) if names and set(names) != set(self.rigid_names)]
        return hash_arrays(self.labels, self.affine, *named)

    def save(self, path: Path | str) -> None:
        """Write ``NAME.nii.gz`` (scanner frame, as any viewer expects) and beside it ``NAME.json``."""
        import nibabel as nib

        path = Path(path)
        image = nib.Nifti1Image(self.labels.astype(np.uint8), self.world_to_scanner @ self.affine)
        with atomic_path(path) as temporary:
            nib.save(image, temporary)
        write_json(sidecar(path), {
            "affine": self.affine, "world_to_scanner": self.world_to_scanner,
            "soft_names": self.soft_names, "rigid_names": self.rigid_names, "cut_names": self.cut_names,
            "target_names": self.target_names, "phantom": self.phantom,
            "doubts": self.doubts,
        })
        label_map_files(path).seal(path.parent, [path.name, sidecar(path).name])

    @staticmethod
    def load(path: Path | str) -> "LabelMap":
        """Read what `save` wrote.

        Raises:
            InputError: absent or damaged.
        """
        path = Path(path)
        # gzip's own checksum is not looked at by nibabel.
        label_map_files(path).check(path.parent, path.name, sidecar(path).name)
        about = load_record(_About, sidecar(path), remake=_REMAKE)
        affine, world_to_scanner = (np.array(rows, dtype=np.float64) for rows in (about.affine, about.world_to_scanner))
        try:
            labels = np.asarray(read_labels(path))
        except InputError:
            raise
        except Exception as error:  # nibabel raises many kinds: zlib, EOF, header
            raise InputError(
                str(path), expected="a label map and its description", got=f"{type(error).__name__}: {error}",
                fix=_REMAKE,
            ) from error
        known = len(about.soft_names) + len(about.rigid_names)
        ArraySpec("index", ("i", "j", "k"), low=0, high=known).check(labels, str(path), extents={}, remake=_REMAKE)
        for name, matrix in (("affine", affine), ("world_to_scanner", world_to_scanner)):
            if abs(np.linalg.det(matrix)) < 1e-12:
                raise InputError(
                    f"{sidecar(path)}: {name}", expected="a matrix that can be inverted", got="another one",
                    fix=_REMAKE,
                )
        return LabelMap(
            labels.astype(np.uint8), affine, world_to_scanner, about.soft_names, about.rigid_names, about.doubts,
            about.cut_names, about.target_names, about.phantom,
        )


def label_map_files(path: Path) -> Artefact:
    """The manifest ``NAME.manifest.json`` of a label map."""
    name = sidecar(path).name.removesuffix(".json")
    return Artefact("label map", 1, _REMAKE, f"{name}.manifest.json")


def sidecar(path: Path) -> Path:
    """The description that belongs to the image of a label map."""
    return path.with_name(path.name.removesuffix(".gz").removesuffix(".nii") + ".json")
