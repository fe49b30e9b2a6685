"""Sphinx configuration: `python -m sphinx -W --keep-going docs build/docs` builds the pages."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import flag_env
from docs._generate.quoted import quoted

project = "flag_env"
author = "The flag_env authors"
copyright = author
version = release = flag_env.__version__

extensions = [
    "docs._generate",
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_generated", "_generate"]
default_role = "code"
suppress_warnings = ["ref.python"]  # shapes in docstrings, such as (copies, 3), are no references

myst_enable_extensions = ["colon_fence", "deflist", "substitution"]
myst_heading_anchors = 4
myst_substitutions = quoted()

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True}
napoleon_google_docstring = True
napoleon_numpy_docstring = True
napoleon_use_ivar = True
napoleon_use_rtype = False
autodoc_mock_imports = ["ray"]

html_theme = "furo"
html_title = "flag_env"
html_static_path = ["_static"]
html_css_files = ["style.css"]
html_show_sourcelink = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0b6e99", "color-brand-content": "#0b6e99"},
    "dark_css_variables": {"color-brand-primary": "#5ec1ea", "color-brand-content": "#5ec1ea"},
    "footer_icons": [],
}
copybutton_prompt_text = "$ "
pygments_style = "friendly"
pygments_dark_style = "github-dark"
