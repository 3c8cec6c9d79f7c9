"""The site: Sphinx with MyST pages. Built offline, and everything a page needs lies beside it."""

import importlib.metadata

project = "MIXPINN"
author = "The MIXPINN developers"
release = importlib.metadata.version("mixpinn")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["results/*"]
nitpicky = False

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

html_theme = "furo"
html_title = f"MIXPINN {release}"
html_copy_source = False
