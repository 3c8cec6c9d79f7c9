"""Answer: how the body stands under a press, wherever that is known from: a full solve, a model, or a refinement."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.manifest import refuse_sealed
from mixpinn.records.error_budget import TotalError
from mixpinn.records.tissue_mesh import TissueMesh
from mixpinn.records.vtu import TetraGrid

if TYPE_CHECKING:
    import pyvista as pv

_SUFFIXES = (".vtu", ".stl", ".ply")


class Source(StrEnum):
    """Where an answer comes from."""

    FULL_SOLVE = "full solve"
    HYBRID_POSE = "hybrid model, from the probe's pose"
    HYBRID_CONTACT = "hybrid model, from contact displacements"
    NETWORK = "network, from contact displacements"
    REFINED = "hybrid model, refined by the solver"


@dataclass(frozen=True, eq=False)
class Motion:
    """Rigid motion of one part.

    Attributes:
        translation: displacement of its centroid [mm], shape (3,).
        rotation_vector: axis times angle [rad], shape (3,).
        rotation: the same as a matrix, shape (3, 3).
    """

    translation: FloatArray
    rotation_vector: FloatArray
    rotation: FloatArray

    @property
    def distance(self) -> float:
        """How far its centroid moved [mm]."""
        return float(np.linalg.norm(self.translation))

    @property
    def angle_deg(self) -> float:
        """By how much it turned [degree]."""
        return float(np.rad2deg(np.linalg.norm(self.rotation_vector)))


@dataclass(frozen=True, eq=False)
class Contact:
    """The nodes that the probe holds or loads; l nodes.

    Attributes:
        nodes: of the mesh, each once, shape (l,).
        displacement: of each [mm], shape (l, 3); a node may be held at exactly zero.
        forces: of the probe on each [N], shape (l, 3); None where they are not known.
    """

    nodes: IntArray
    displacement: AnyArray
    forces: FloatArray | None = None


@dataclass(frozen=True)
class Trust:
    """What to think of an answer.

    The errors are those against the solver that the model learned from, on its mesh and elements; how far these are
    from the converged solution is another question.

    Attributes:
        expected: expected mean Euclidean error [mm]; None where it is not known.
        bound: what that error stays below with probability `level` [mm]; None where it is not known.
        level: probability of the bound; None where there is no bound.
        outside: whether the input lies outside of what the model has seen; `expected` and `bound` mean little then.
        reasons: why the answer is outside or did not converge, and what else is to be known of it, in words.
        converged: whether every solve met its tolerance.
        residual: relative residual of the equilibrium; None where it was not evaluated.
        force_expected, force_bound: the same as `expected` and `bound` for the force on the probe [N].
        motion_expected, motion_bound: the same for the largest error of a rigid part's translation [mm].
    """

    expected: float | None = None
    bound: float | None = None
    level: float | None = None
    outside: bool = False
    reasons: tuple[str, ...] = ()
    converged: bool = True
    residual: float | None = None
    force_expected: float | None = None
    force_bound: float | None = None
    motion_expected: float | None = None
    motion_bound: float | None = None

    @property
    def sound(self) -> bool:
        """Whether nothing speaks against the answer: converged, and within what the model has seen."""
        return self.converged and not self.outside


@dataclass(frozen=True, eq=False)
class Answer:
    """Displacement of the whole body, and what goes with it; n mesh nodes.

    Attributes:
        mesh: the mesh.
        displacement: of every mesh node, or of every vertex [mm], shape (n, 3).
        source: where it comes from.
        model: name of the model or solver.
        force: of the tissue on the probe [N], shape (3,), or (k, 3) of k probes; None where it is not known.
        moment: the same forces' moment about the probe's tip [N mm], shape (3,) or (k, 3).
        motions: of each rigid part, by name.
        contact: the nodes that are held or loaded; None where they are not known.
        trust: what to think of it; None where nothing is known.
        discretisation: elements and mesh that it refers to.
        reference: the displacement that was to be found, if known [mm], of these nodes or of more, shape (≥ n, 3).
        history: to hand to the next call of the same solver or model; None where an answer does not depend on one.
        total: how far it may be from the converged solution; None where its bundle carries no error budget.
    """

    mesh: TissueMesh
    displacement: AnyArray
    source: Source
    model: str = ""
    force: FloatArray | None = None
    moment: FloatArray | None = None
    motions: Mapping[str, Motion] = field(default_factory=dict)
    contact: Contact | None = None
    trust: Trust | None = None
    discretisation: str = ""
    reference: AnyArray | None = None
    history: object | None = None
    total: TotalError | None = None

    def describe(self) -> tuple[str, ...]:
        """Force, motions, trust and total error in words, a line each."""
        lines = []
        if self.force is not None:
            for force in np.atleast_2d(self.force):
                x, y, z = force
                lines.append(f"Force on the probe: {np.linalg.norm(force):.2f} N ({x:.2f}, {y:.2f}, {z:.2f})")
        lines += [
            f"{name}: moved by {motion.distance:.2f} mm, turned by {motion.angle_deg:.2f}°"
            for name, motion in self.motions.items()
        ]
        if self.trust is not None and self.trust.expected is not None and self.trust.bound is not None:
            lines.append(
                f"Expected mean error against the solver: {self.trust.expected:.3f} mm, with "
                f"{100.0 * (self.trust.level or 0.0):.0f} % probability below {self.trust.bound:.3f} mm"
            )
            if self.trust.force_bound is not None and self.trust.motion_bound is not None:
                lines.append(
                    f"With the same probability the force errs by less than {self.trust.force_bound:.2f} N, the "
                    f"motions by less than {self.trust.motion_bound:.3f} mm"
                )
        if self.total is not None:
            force = None if self.force is None else float(np.linalg.norm(np.atleast_2d(self.force), axis=1).max())
            moved = max((motion.distance for motion in self.motions.values()), default=None)
            lines.append(self.total.describe(force, moved))
        return tuple(lines)

    def warnings(self) -> tuple[str, ...]:
        """What speaks against the answer, in words, a line each; of a sound one what else there is to know."""
        trust = self.trust
        if trust is None:
            return ()
        if trust.sound:
            return trust.reasons
        verdict = "the answer did not converge" if not trust.converged else "the answer is outside of what is known"
        return tuple(f"{verdict}: {reason}" for reason in trust.reasons) or (verdict,)

    def grid(self) -> "pv.UnstructuredGrid":
        """The deformed mesh with point data ``displacement`` and, where the reference is known, ``error`` [mm]."""
        import pyvista as pv

        return pv.UnstructuredGrid(self._tetra_grid().vtk())

    def save(self, path: Path | str) -> None:
        """Write the deformed mesh: ``.vtu`` with all fields, or the surface as ``.stl`` or ``.ply``.

        Raises:
            InputError: another suffix, or a folder that cannot be written.
        """
        from mixpinn.records.vtk_file import write_vtk

        path = checked_output(path)
        if path.suffix == ".vtu":
            write_vtk(path, self._tetra_grid().vtk())
        else:
            write_vtk(path, self.grid().extract_surface(algorithm="dataset_surface"))

    def _tetra_grid(self) -> TetraGrid:
        grid = self.mesh.tetra_grid(self.displacement)
        if self.reference is None:
            return grid
        reference = self.reference[: len(self.displacement)]
        error = np.linalg.norm(self.displacement - reference, axis=1)
        return replace(grid, point_data={**grid.point_data, "reference": reference, "error": error})


def checked_output(path: Path | str) -> Path:
    """`path` as one that `Answer.save` can write.

    Raises:
        InputError: another suffix than ``.vtu``, ``.stl`` or ``.ply``, or a file of a bundle or another artefact.
    """
    path = Path(path)
    if path.suffix not in _SUFFIXES:
        raise InputError(
            str(path), expected=".vtu, .stl or .ply", got=path.suffix or "no suffix", fix="rename the output",
        )
    refuse_sealed(path)
    return path


def discretisation_of(mesh: TissueMesh, under_probe: str = "") -> str:
    """Elements and size of a mesh in words; `under_probe` says what its cells were refined to there."""
    kind = "linear" if mesh.order == 1 else "quadratic"
    finer = f", {under_probe} under the probe" if under_probe else ""
    return f"{kind} tetrahedra, {mesh.n_nodes} nodes{finer}, mesh {mesh.hash()}"
