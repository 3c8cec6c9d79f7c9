"""A picture of a mesh: the skin translucent with the rigid parts inside, and a sagittal cut."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path
from mixpinn.records.tissue_mesh import TissueMesh

if TYPE_CHECKING:
    import pyvista as pv

_SKIN, _TISSUE = "#e8beac", "#d9d4cf"
_PARTS = (
    "#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#e07b39", "#8c7ac6", "#1f5a8a", "#a65628",
    "#66c2a5", "#5b7a1e", "#7f7f7f", "#c49c94", "#dbdb8d", "#b22222",
)


def draw_mesh(mesh: TissueMesh, path: Path | str, *, size: tuple[int, int] = (1600, 800)) -> None:
    """Render `mesh` off-screen to a ``.png``.

    Raises:
        InputError: this machine cannot render.
    """
    import pyvista as pv

    try:
        with pv.vtk_verbosity("off"):
            _render(mesh, path, size)
    except (RuntimeError, AttributeError) as error:
        raise InputError(
            str(path), expected="a machine that can render off-screen", got=str(error),
            fix="leave the picture out (picture=false) or install Mesa (libosmesa6, libgl1)",
        ) from error


def _render(mesh: TissueMesh, path: Path | str, size: tuple[int, int]) -> None:
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, shape=(1, 2), window_size=list(size), border=False)
    plotter.set_background("white")
    _draw_inside(plotter, mesh)
    plotter.subplot(0, 1)
    _draw_cut(plotter, mesh)
    with atomic_path(path) as temporary:
        plotter.screenshot(temporary)
    plotter.close()


def _draw_inside(plotter: "pv.Plotter", mesh: TissueMesh) -> None:
    import pyvista as pv

    plotter.add_mesh(
        pv.PolyData.from_regular_faces(mesh.points, mesh.skin_faces), color=_SKIN, opacity=0.3, show_edges=True,
        edge_opacity=0.15,
    )
    faces = mesh.boundary_faces
    owner = np.sort(mesh.part[faces], axis=1)[:, 1]
    for k, name in enumerate(mesh.rigid_names, start=1):
        if (owner == k).any():
            surface = pv.PolyData.from_regular_faces(mesh.points, faces[owner == k]).flip_faces()
            plotter.add_mesh(surface, color=_PARTS[(k - 1) % len(_PARTS)], label=name, smooth_shading=False)
    if mesh.fixed.any():
        plotter.add_points(
            mesh.points[mesh.fixed], color="black", point_size=6.0, render_points_as_spheres=True, label="fixed",
        )
    if mesh.rigid_names or mesh.fixed.any():
        plotter.add_legend(bcolor=None, face="circle", size=(0.22, 0.2))
    _look(plotter, (-1.6, 1.6, -0.7))


def _draw_cut(plotter: "pv.Plotter", mesh: TissueMesh) -> None:
    import pyvista as pv

    centre = mesh.target_points.mean(axis=0)
    plotter.add_mesh(
        mesh.grid().slice(normal="x", origin=centre), color=_TISSUE, show_edges=True, line_width=0.5, lighting=False,
    )
    faces = mesh.boundary_faces
    owner = np.sort(mesh.part[faces], axis=1)[:, 1]
    beyond = mesh.points[faces].mean(axis=1)[:, 0] <= centre[0]
    for k in range(1, mesh.n_parts + 1):
        if ((owner == k) & beyond).any():
            surface = pv.PolyData.from_regular_faces(mesh.points, faces[(owner == k) & beyond])
            plotter.add_mesh(surface, color=_PARTS[(k - 1) % len(_PARTS)], show_edges=True, line_width=0.5)
    _look(plotter, (1.0, 0.15, -0.1))


def _look(plotter: "pv.Plotter", direction: tuple[float, float, float]) -> None:
    """View along −`direction`, the head (−z) up."""
    plotter.view_vector(direction, viewup=(0.0, 0.0, -1.0))
    plotter.camera.zoom(1.25)
