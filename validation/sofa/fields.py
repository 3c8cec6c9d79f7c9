"""The recorded fields of SOFA, and the scene that they belong to."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.fem import PAPER_TISSUE, ContactConfig, Scene, SkinSurface, SolverConfig
from mixpinn.geometry.rotations import rotation_about_y
from mixpinn.mesh import load_paper_mesh
from mixpinn.records import Probe, ProbePath, TissueMesh

APPROACH = 8
"""Steps before depth 1."""


def data_folder() -> Path | None:
    """Folder of the recorded fields (environment variable MIXPINN_DATA), or None where it is absent."""
    folder = Path(os.environ.get("MIXPINN_DATA", Path(__file__).parents[2] / ".." / "shared" / "data")).resolve()
    return folder if (folder / "sofa").is_dir() else None


def paper_folder(folder: Path) -> Path:
    """The paper's mesh, probe and positions within the data."""
    return folder / "patient1" / "paper"


def paper_mesh(folder: Path) -> TissueMesh:
    """The paper's mesh."""
    return load_paper_mesh(paper_folder(folder))


@dataclass(frozen=True, eq=False)
class Recording:
    """What SOFA computed for one pose.

    Attributes:
        name: file name without suffix.
        displacement: of each step [mm], shape (s, n, 3).
        nodes, forces: of each step, nodes in contact and the forces on them [N].
        tips: tip of the collision mesh [mm], shape (s, 3).
        rotation_deg: of the probe about y.
    """

    name: str
    displacement: FloatArray
    nodes: list[IntArray]
    forces: list[FloatArray]
    tips: FloatArray
    rotation_deg: float

    @staticmethod
    def load(path: Path) -> "Recording":
        """Read the frames of one pose."""
        with np.load(path) as data:
            offsets = data["contact_offsets"]
            spans = [slice(*offsets[k : k + 2]) for k in range(len(offsets) - 1)]
            nodes, forces = data["contact_nodes"].astype(np.int64), data["contact_forces_mN"] * 1e-3
            return Recording(
                path.stem, data["displacement_um"] * 1e-3, [nodes[span] for span in spans],
                [forces[span].astype(np.float64) for span in spans], data["contact_probe_position"].astype(np.float64),
                float(path.stem.split("_")[2]),
            )

    def path(self) -> ProbePath:
        """The probe's path."""
        return straight_path(self.tips, self.rotation_deg)


@dataclass(frozen=True, eq=False)
class StaticField:
    """The converged field at the last position of a pose: displacement [mm], probe's force on the body [N], path."""

    name: str
    displacement: FloatArray
    force: FloatArray
    path: ProbePath

    @staticmethod
    def load(path: Path, positions: FloatArray) -> "StaticField":
        """Read a static field; the path leads from 8 mm above the listed position straight down to its probe."""
        with np.load(path) as data:
            position = positions[int(data["position_index"])]
            last = float(data["contact_probe_y"])
            heights = np.arange(position[1] + APPROACH, last - 1e-6, -1.0)
            tips = np.column_stack([np.full(len(heights), position[0]), heights, np.full(len(heights), position[2])])
            assert abs(heights[-1] - last) < 1e-3
            return StaticField(
                path.stem, data["displacement"].astype(np.float64),
                data["contact_forces_mN"].astype(np.float64).sum(axis=0) * 1e-3,
                straight_path(tips, float(data["rotation_deg"])),
            )


def straight_path(tips: FloatArray, rotation_deg: float) -> ProbePath:
    """A path of given tips [mm] at a constant rotation about y [degrees]."""
    turn = rotation_about_y(rotation_deg)
    return ProbePath(tips, np.tile(turn, (len(tips), 1, 1)), np.arange(len(tips)) - float(APPROACH))


def sofa_scene(folder: Path, mesh: TissueMesh, **contact: Any) -> Scene:
    """The paper's set-up with SOFA's own collision patch as the skin.

    Friction is measured as SOFA measures it: the probe's vertices are set from step to step, so that the tangential
    motion of a contact is that of the skin alone, and the probe's own motion does not drag the skin.
    """
    paper = paper_folder(folder)
    patch = Probe.load(paper / "body_collision.stl")
    options = {"gap": 2.0, "alarm": 4.0, "friction": 1.0, "spacing": 0.5, "dragging": False, **contact}
    return Scene(
        mesh, Probe.load(paper / "probe_collision.stl"), (PAPER_TISSUE,),
        ContactConfig(**options),
        SolverConfig(threads=1), SkinSurface.embedded(mesh, patch.points, patch.triangles),
    )
