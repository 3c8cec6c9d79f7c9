"""Every example runs, and ends in a check that does not come from its own output."""

import ast
import runpy
from pathlib import Path

import matplotlib as mpl
import pytest
import pyvista as pv

from mixpinn.evaluation import RenderingUnavailable, start_rendering

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
FULL_SIZE = {"tiny_phantom": "make_phantom", "size=4.0": "size=1.5", "size=3.0": "size=1.5"}
"""What `make drill` replaces in the scripts: the whole phantom on a mesh near the paper's."""


@pytest.fixture(autouse=True)
def no_windows(monkeypatch):
    """Plots are made and dropped; where nothing can be drawn in three dimensions, those are left out."""
    mpl.use("agg")
    try:
        start_rendering()
    except RenderingUnavailable:
        monkeypatch.setattr(pv.Plotter, "show", lambda self, **_: None)
    monkeypatch.setattr(pv, "OFF_SCREEN", True)


def test_there_are_enough():
    assert len(EXAMPLES) >= 10


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_runs_and_checks_itself(path, drill, tmp_path, monkeypatch):
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    assert any(isinstance(node, ast.Assert) for node in tree.body), "an example pins at least one number"
    assert len(text.splitlines()) <= 110, "an example is short"
    if drill:
        for small, full in FULL_SIZE.items():
            text = text.replace(small, full)
    script = tmp_path / path.name
    script.write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="example")
