"""Full solves of an error budget: presses over the rigid parts, each solve kept in a file of its own."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.array_file import read_npz
from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path
from mixpinn.base.validated import ArraySpec
from mixpinn.fem import Scene
from mixpinn.fem.contact.surfaces import SkinSurface
from mixpinn.fem.solve.pose import solve_pose
from mixpinn.geometry.first_touch import first_touch
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Answer
from mixpinn.serving.motions import motion_matrices

_REMAKE = "delete it: 'mixpinn assess' solves it again"
_ARRAYS = {
    "force": ArraySpec("number", (3,)), "translations": ArraySpec("number", ("K", 3)),
    "field": ArraySpec("number", ("n", 3)), "converged": ArraySpec("flag", ()),
}


@dataclass(frozen=True, eq=False)
class Press:
    """A straight press: a line over the skin and how the probe is turned.

    Attributes:
        place: a point on the line [mm], shape (3,).
        rotation: of the probe, shape (3, 3).
    """

    place: FloatArray
    rotation: FloatArray

    def tip(self, scene: Scene, depth: float) -> FloatArray:
        """The tip `depth` [mm] beyond first touch of the scene's skin, shape (3,).

        Raises:
            InputError: no skin lies in the probe's way.
        """
        skin = scene.skin or SkinSurface.of_mesh(scene.mesh)
        touch = first_touch(
            self.place, self.rotation, points=skin.vertices(scene.mesh.node_points),
            triangles=skin.surface.triangles, probe=scene.probe, gap=scene.contact.gap,
        )
        return touch + depth * (self.rotation @ PROBE_AXIS)


@dataclass(frozen=True, eq=False)
class Found:
    """What a press does; K rigid parts, n vertices of the bundle's mesh.

    Attributes:
        force: of the tissue on the probe [N], shape (3,).
        translations: of the rigid parts at the centroids of the bundle's mesh [mm], shape (K, 3).
        field: displacement of the vertices of the bundle's mesh [mm], shape (n, 3); empty where meshes differ.
        converged: whether the solver met its tolerance down to the full depth.
    """

    force: FloatArray
    translations: FloatArray
    field: FloatArray
    converged: bool

    @staticmethod
    def of(answer: Answer, mesh: TissueMesh, *, same_vertices: bool = True) -> "Found":
        """Read off an answer, in terms of the bundle's mesh."""
        assert answer.force is not None
        centroids = np.array([mesh.points[mesh.part_nodes(k)].mean(axis=0) for k in range(1, mesh.n_parts + 1)])
        moved = motion_matrices(answer.mesh, answer.motions)
        arms = np.einsum("kij,kj->ki", moved[:, :3, :3], centroids.reshape(-1, 3)) + moved[:, :3, 3]
        field = np.asarray(answer.displacement[:mesh.n_points if same_vertices else 0], dtype=np.float64)
        return Found(
            np.asarray(answer.force, dtype=np.float64), arms - centroids.reshape(-1, 3), field,
            answer.trust is None or answer.trust.converged,
        )

    def extrapolated(self, base: "Found", scale: float) -> "Found":
        """What a change `scale` times as large would do, if it does so in proportion: base + s (this − base)."""
        return Found(
            base.force + scale * (self.force - base.force),
            base.translations + scale * (self.translations - base.translations),
            base.field + scale * (self.field - base.field) if len(self.field) else self.field, self.converged,
        )

    def save(self, path: Path) -> None:
        """Write as ``.npz``."""
        with atomic_path(path) as temporary, Path(temporary).open("wb") as file:
            np.savez(
                file, force=self.force, translations=self.translations, field=self.field.astype(np.float32),
                converged=np.array(self.converged),
            )

    @staticmethod
    def load(path: Path) -> "Found":
        """Read what `save` wrote.

        Raises:
            InputError: a damaged file.
        """
        try:
            kept = read_npz(path, tuple(_ARRAYS))
            for name, spec in _ARRAYS.items():
                spec.check(kept[name], f"{path}: {name}", extents={}, remake=_REMAKE)
            return Found(
                kept["force"], kept["translations"], kept["field"].astype(np.float64), bool(kept["converged"]),
            )
        except (OSError, KeyError, ValueError) as error:
            raise InputError(str(path), expected="a kept solve", got=type(error).__name__, fix=_REMAKE) from error


def presses(mesh: TissueMesh, rotation: FloatArray, count: int) -> list[Press]:
    """Lines over the rigid parts, evenly spread along the body and alternately to the right and left of their middle.

    Args:
        mesh: at rest.
        rotation: of the probe, shape (3, 3).
        count: how many.
    """
    points = mesh.target_points
    low, high = points.min(axis=0), points.max(axis=0)
    found = []
    for index in range(count):
        share = (index + 0.5) / count
        side = 0.0 if count == 1 else 0.25 * (-1.0) ** index
        place = np.array([
            0.5 * (low[0] + high[0]) + side * (high[0] - low[0]), mesh.points[:, 1].max(),
            low[2] + share * (high[2] - low[2]),
        ])
        found.append(Press(place, rotation))
    return found


def solve_kept(
    folder: Path, scene: Scene, press: Press, mesh: TissueMesh, *, depth: float, same_vertices: bool = True,
) -> Found:
    """The solve of a press, from `folder` where it was done before.

    Args:
        folder: where solves are kept, by the hash of their scene and the tip.
        scene: that is solved.
        press: of the probe.
        mesh: of the bundle, in terms of which the result is given.
        depth: beyond first touch [mm].
        same_vertices: whether the scene's first vertices are those of `mesh`.

    Raises:
        InputError: a damaged file, or no skin in the probe's way.
    """
    tip = press.tip(scene, depth)
    path = folder / f"{scene.hash()}-{'_'.join(f'{value:.3f}' for value in tip)}.npz"
    if not path.is_file():
        Found.of(solve_pose(scene, tip, press.rotation), mesh, same_vertices=same_vertices).save(path)
    return Found.load(path)  # in the precision that is kept, so that a later run comes to the same
