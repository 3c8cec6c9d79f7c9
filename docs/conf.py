"""The site: Sphinx with MyST pages and a gallery of the examples. Built offline; all a page needs lies beside it."""

import importlib.metadata
import os
import sys
from pathlib import Path
from typing import Any

import pyvista

from mixpinn.base.progress import console
from mixpinn.evaluation import RenderingUnavailable, start_rendering

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "docs"), str(ROOT)]

from architecture import draw as draw_architecture  # noqa: E402 (beside this file)

draw_architecture(ROOT / "docs" / "generated" / "architecture.svg")

project = "MIXPINN"
author = "The MIXPINN developers"
copyright = author
release = importlib.metadata.version("mixpinn")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_gallery.gen_gallery"]
exclude_patterns = ["gallery/*.ipynb", "gallery/*.py"]

# Pages are Markdown with formulas in plain Unicode: no MathJax, so no request leaves the reader's browser.
myst_enable_extensions = ["colon_fence", "deflist", "attrs_inline"]
myst_heading_anchors = 3

# Single backticks in docstrings mark a name, as in Markdown.
default_role = "literal"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"

# The gallery runs every example. Where this machine cannot draw, the scripts are shown and not run.
os.environ.setdefault("MPLBACKEND", "agg")
try:
    start_rendering()
    draws = True
except RenderingUnavailable as error:
    print(f"the gallery is not run: {error}")
    draws = False
pyvista.OFF_SCREEN = True
console.quiet = True  # progress bars are not output
pyvista.BUILDING_GALLERY = True

READING_ORDER = (
    "phantom", "own_anatomy", "own_probe", "own_tissue", "own_material", "own_network", "hybrid_model", "elastic_prior",
    "force_control", "learning_environment", "contact_pressure", "energy_balance", "stretched_bar", "metrics",
)


def reading_order(filename: str) -> tuple[int, str]:
    """Place of an example in the gallery; those that are not named come last."""
    stem = Path(filename).stem
    return (READING_ORDER.index(stem) if stem in READING_ORDER else len(READING_ORDER), stem)


sphinx_gallery_conf = {
    "examples_dirs": str(ROOT / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "plot_gallery": draws,
    "image_scrapers": ("pyvista", "matplotlib") if draws else ("matplotlib",),
    "within_subsection_order": "conf.reading_order",
    "abort_on_example_error": True,
    "show_memory": False,
    "write_computation_times": False,
    "download_all_examples": False,
    "show_signature": False,
    "remove_config_comments": True,
}



def escape_bars(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Keep |x| in a docstring's formula what it is: to reStructuredText it is a substitution."""
    for index, line in enumerate(lines):
        parts = line.split("`")
        parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
        lines[index] = "`".join(parts)


def setup(app: Any) -> None:
    """Sphinx's hook."""
    app.connect("autodoc-process-docstring", escape_bars)


html_theme = "furo"
html_title = f"MIXPINN {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
