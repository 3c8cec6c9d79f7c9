"""Three-dimensional pictures of one sample: prediction over reference, a cut through the body, a map of the error."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.evaluation.metrics import euclidean_errors, part_label
from mixpinn.evaluation.rendering_backend import RenderingUnavailable, start_rendering
from mixpinn.evaluation.rendering_camera import aim, in_front, new_plotter, shoot
from mixpinn.records import Probe, SampleTable, TissueMesh

PART_COLOURS = (
    "#4C9BD6", "#E69F00", "#2FA67F", "#D87BB0", "#E07B39", "#8C7AC6", "#B5A642", "#1F5A8A", "#A65628", "#66C2A5",
    "#984EA3", "#F4A6A0", "#5B7A1E", "#AEC7E8", "#7F7F7F", "#C49C94", "#17BECF", "#DBDB8D", "#B22222", "#9EDAE5",
)
"""One a part; from the twenty-first on they begin anew."""
_TISSUE, _PROBE, _INK = "#F0D3C0", "#56616B", "#222222"
_FEM, _FEM_LINE, _PREDICTED = "#C9CDD2", "#6C737A", "#D7191C"
_MATT = {"smooth_shading": False, "ambient": 0.42, "diffuse": 0.56, "specular": 0.0}
_SIDE = (-1.0, 0.45, -0.4)
"""Direction from which the lengthwise cut is seen: from the patient's left, the back up, the head to the left."""


@dataclass(frozen=True, eq=False)
class Case:
    """One sample with the answer of one model.

    Attributes:
        mesh: of the sample.
        reference: displacement by finite elements [mm], shape (n, 3).
        predicted: displacement by the model [mm], shape (n, 3).
        model: its name.
        tip: position of the probe's tip [mm], shape (3,).
        depth: indentation depth [mm].
        probe: its surface, if it is to be shown.
        rotation: the probe's rotation matrix, shape (3, 3).
    """

    mesh: TissueMesh
    reference: AnyArray
    predicted: AnyArray
    model: str
    tip: FloatArray
    depth: float
    probe: Probe | None
    rotation: FloatArray

    @staticmethod
    def of(
        mesh: TissueMesh, table: SampleTable, index: int, predicted: AnyArray, *, model: str,
        probe: Probe | None = None,
    ) -> "Case":
        """Sample `index` of `table` with the displacement that `model` predicts [mm], shape (n, 3), at the vertices."""
        return Case(
            mesh, table.displacement[index, : mesh.n_points], predicted[: mesh.n_points], model,
            table.probe_translation[index], float(table.depth[index]), probe, table.probe_rotation[index],
        )

    @property
    def title(self) -> str:
        """Model and depth in words."""
        return f"{self.model} at {self.depth:.0f} mm indentation"

    @property
    def centre(self) -> FloatArray:
        """Point on which the cuts are centred [mm], shape (3,): the middle of the targets, else of the mesh."""
        points = self.mesh.target_points
        middle: FloatArray = (points.min(axis=0) + points.max(axis=0)) / 2.0
        return middle


@dataclass(frozen=True)
class Picture:
    """A picture file and what it shows."""

    path: Path
    caption: str


def render_pictures(case: Case, folder: Path | str) -> tuple[tuple[Picture, ...], str]:
    """Draw all three pictures of a case into `folder`.

    Returns:
        The pictures and an empty note; or no picture and the note that says why.
    """
    folder = Path(folder)
    try:
        start_rendering()
    except RenderingUnavailable as error:
        return (), str(error)
    return (
        render_comparison(case, folder / "prediction.png"),
        render_cut(case, folder / "cut.png"),
        render_error_map(case, folder / "error.png"),
    ), ""


def render_comparison(case: Case, path: Path | str) -> Picture:
    """Predicted mesh as red wire-frame over the grey finite-element mesh: a section near the probe.

    Raises:
        RenderingUnavailable: this machine cannot draw.
    """
    view = np.array([-0.32, 0.42, -1.0])
    reference, predicted = (
        _surface(_section(case.mesh.grid(field), case.tip)) for field in (case.reference, case.predicted)
    )
    plotter = new_plotter((1500, 1000))
    plotter.add_mesh(reference, color=_FEM, **_MATT)
    for surface, colour, distance in ((reference, _FEM_LINE, 1.0), (predicted, _PREDICTED, 4.0)):
        lines = in_front(surface.extract_all_edges(), view, distance)
        plotter.add_mesh(lines, color=colour, line_width=1.8, lighting=False)
    probe = _add_probe(plotter, case, opacity=0.3)
    aim(plotter, np.concatenate([reference.points, _close_to(probe, case.tip, 45.0)]), view)
    plotter.add_legend(
        [[f"{case.model}, predicted", _PREDICTED], ["Finite elements", _FEM_LINE]], bcolor="white",
        background_opacity=0.85, size=(0.24, 0.075), loc="lower left", face="rectangle",
    )
    shoot(plotter, path)
    return Picture(Path(path), (
        f"Prediction of {case.title} (red wire-frame) over the finite-element mesh (grey). "
        "Only a section near the probe is shown, cut across the body."
    ))


def render_cut(case: Case, path: Path | str) -> Picture:
    """The body deformed by finite elements, cut lengthwise, the rigid parts whole and coloured.

    Raises:
        RenderingUnavailable: this machine cannot draw.
    """
    plotter = new_plotter((1500, 1000))
    grid = case.mesh.grid(case.reference)
    body = _surface(grid.clip(normal="x", origin=case.centre, invert=False))
    plotter.add_mesh(body, color=_TISSUE, **_MATT)
    lines = grid.slice(normal="x", origin=case.centre).extract_all_edges()
    plotter.add_mesh(in_front(lines, _SIDE, 1.0), color="#c49a82", line_width=1.2, lighting=False)
    legend = []
    for k, surface in _rigid_surfaces(case):
        colour = PART_COLOURS[(k - 1) % len(PART_COLOURS)]
        plotter.add_mesh(surface, color=colour, **_MATT)
        legend.append([part_label(case.mesh.rigid_names[k - 1]), colour])
    probe = _add_probe(plotter, case, opacity=1.0)
    aim(plotter, np.concatenate([_back(body.points, case), _close_to(probe, case.tip, 70.0)]), _SIDE)
    if legend:
        plotter.add_legend(legend, bcolor=None, size=(0.1, 0.038 * len(legend)), loc="upper left", face="rectangle")
    shoot(plotter, path)
    return Picture(Path(path), (
        f"The body at {case.depth:.0f} mm indentation, computed with finite elements and cut lengthwise; "
        "the back is up, the head to the left, the rigid parts are coloured."
    ))


def render_error_map(case: Case, path: Path | str) -> Picture:
    """Distance between predicted and reference position: on the back, and in a cut with the rigid parts [mm].

    Raises:
        RenderingUnavailable: this machine cannot draw.
    """
    error = euclidean_errors(case.predicted, case.reference)
    look = {
        "scalars": "error", "cmap": "YlOrRd", "clim": (0.0, _round_limit(float(np.quantile(error, 0.998)))),
        "show_scalar_bar": False, **_MATT, "ambient": 0.62, "diffuse": 0.36,
    }
    plotter = new_plotter((1900, 950), shape=(1, 2))
    grid = case.mesh.grid(case.reference)
    grid.point_data["error"] = error
    plotter.subplot(0, 0)
    skin = _surface(grid)
    plotter.add_mesh(skin, **look)
    _add_probe(plotter, case, opacity=0.3, length=30.0)
    aim(plotter, skin.points, (-0.3, 1.0, -0.35), up=(0.0, 0.0, -1.0))
    plotter.subplot(0, 1)
    body = _surface(grid.clip(normal="x", origin=case.centre, invert=False))
    plotter.add_mesh(body, **{**look, "show_scalar_bar": True}, scalar_bar_args={
        "title": "Error [mm]\n", "color": _INK, "n_labels": 5, "fmt": "%.3g", "title_font_size": 26,
        "label_font_size": 24, "vertical": True, "width": 0.07, "height": 0.6, "position_x": 0.87, "position_y": 0.18,
    })
    for _, surface in _rigid_surfaces(case):
        surface.point_data["error"] = error
        plotter.add_mesh(surface, **look)
    probe = _add_probe(plotter, case, opacity=0.3)
    aim(
        plotter, np.concatenate([_back(body.points, case), _close_to(probe, case.tip, 70.0)]), _SIDE, margin_right=0.17,
    )
    shoot(plotter, path)
    return Picture(Path(path), (
        f"Distance between prediction and finite elements at each point, {case.title}: on the back (left, head up) "
        "and in the lengthwise cut with the rigid parts (right, head to the left)."
    ))


def _surface(grid: pv.UnstructuredGrid) -> pv.PolyData:
    return grid.extract_surface(algorithm="dataset_surface")


def _section(grid: pv.UnstructuredGrid, tip: FloatArray) -> pv.UnstructuredGrid:
    """A block of the body behind the transverse plane through the probe's tip."""
    low, high = tip - np.array([90.0, 110.0, 0.0]), tip + np.array([90.0, 0.0, 70.0])
    block = grid.clip(normal="z", origin=low, invert=False).clip(normal="z", origin=high)
    block = block.clip(normal="x", origin=low, invert=False).clip(normal="x", origin=high)
    block = block.clip(normal="y", origin=low, invert=False)
    return block if block.n_cells else grid


def _rigid_surfaces(case: Case) -> list[tuple[int, pv.PolyData]]:
    """Number and deformed surface of each rigid part: its cavity's faces, turned outward of the part."""
    mesh, faces = case.mesh, case.mesh.boundary_faces
    own = {k: faces[(mesh.part[faces] == k).all(axis=1)][:, ::-1] for k in range(1, mesh.n_parts + 1)}
    points = mesh.points + case.reference
    return [(k, pv.PolyData.from_regular_faces(points, part)) for k, part in own.items() if len(part)]


def _back(points: AnyArray, case: Case) -> AnyArray:
    """The points from the back to some way below the rigid parts: what a picture of the cut is framed on."""
    rigid = case.mesh.points[case.mesh.part > 0]
    lowest = rigid[:, 1].min() - 45.0 if len(rigid) else -np.inf
    return points[points[:, 1] > lowest]


def _close_to(probe: pv.PolyData | None, tip: FloatArray, length: float) -> AnyArray:
    """The points of the probe within `length` [mm] of its tip, shape (p, 3)."""
    if probe is None:
        return np.empty((0, 3))
    return probe.points[np.linalg.norm(probe.points - tip, axis=1) < length]


def _add_probe(plotter: pv.Plotter, case: Case, *, opacity: float, length: float | None = None) -> pv.PolyData | None:
    """Show the probe, or only its first `length` [mm] from the tip."""
    if case.probe is None:
        return None
    surface = pv.PolyData.from_regular_faces(case.probe.points, case.probe.triangles)
    if length is not None:
        surface = surface.clip(normal="y", origin=(0.0, length, 0.0))
    surface.points = surface.points @ case.rotation.T + case.tip
    plotter.add_mesh(surface, color=_PROBE, opacity=opacity, smooth_shading=True, ambient=0.2, specular=0.2)
    return surface


def _round_limit(value: float) -> float:
    """The smallest of 4 × (1, 1.5, 2, 2.5, 3, 4, 5, 7.5) × 10^k that is no less than `value`: five round labels."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-6) / 4.0))
    limits = 4.0 * power * np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.5, 10.0])
    return float(limits[np.argmax(limits >= value)])
