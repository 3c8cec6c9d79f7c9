"""Whether and how this machine can draw three-dimensional pictures without a display."""

import functools
import os
import subprocess
import sys

from mixpinn.base.errors import MixpinnError

_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
_TRIAL = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere(), color="black")
image = plotter.screenshot(return_img=True)
raise SystemExit(0 if image.min() < 128 < image.max() else 3)
"""


class RenderingUnavailable(MixpinnError):
    """This machine cannot draw three-dimensional pictures; everything else works without."""


def start_rendering() -> None:
    """Make VTK draw off-screen in this process, choosing a render window that works.

    Raises:
        RenderingUnavailable: none does; the message says what to install.
    """
    window = _working_window()
    if window is None:
        raise RenderingUnavailable(
            "3-D pictures were left out: this machine has neither a display nor off-screen OpenGL "
            "(on Debian or Ubuntu: apt-get install libegl1 libgl1-mesa-dri)"
        )
    if window:
        os.environ[_VARIABLE] = window


@functools.cache
def _working_window() -> str | None:
    """Name of VTK's first render window that draws ("" for its default), or None.

    Each is tried in a process of its own, for VTK ends the whole process where a library is missing.
    """
    candidates = [""]
    if sys.platform.startswith("linux"):
        off_screen = ["vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"]
        candidates = ["", *off_screen] if os.environ.get("DISPLAY") else [*off_screen, ""]
    for window in [os.environ[_VARIABLE]] if _VARIABLE in os.environ else candidates:
        environment = {**os.environ, _VARIABLE: window} if window else dict(os.environ)
        try:
            trial = subprocess.run(
                [sys.executable, "-c", _TRIAL], env=environment, capture_output=True, timeout=120, check=False,
            )
        except subprocess.TimeoutExpired:
            continue
        if trial.returncode == 0:
            return window
    return None
