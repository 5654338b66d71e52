"""The documentation site: Sphinx over Markdown pages, notebooks and docstrings; it works offline from files."""

import shutil
import sys
from pathlib import Path

import evalkit

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "extensions"))

project = "evalkit"
author = "The evalkit authors"
copyright = author
version = release = evalkit.__version__

extensions = [
    "sphinx.ext.autodoc",
    "numpydoc",
    "myst_nb",
    "generated",
    "mathml",
]
exclude_patterns = ["_build", "extensions"]
nitpicky = True
nitpick_ignore = [("py:class", "pyvista.Plotter")]  # another project's, whose inventory would have to be fetched

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
myst_links_external_new_tab = False
suppress_warnings = ["ref.citation"]  # sources that a docstring lists and does not cite by number

# Notebooks are executed by `make notebooks`, which has the assertions; here they are shown.
nb_execution_mode = "off"
nb_ipywidgets_js = {}
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc sections say type, shape and unit
autodoc_default_options = {"no-value": True}
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

html_theme = "furo"
html_title = f"evalkit {version}"
html_static_path = ["static"]
html_css_files = ["evalkit.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
templates_path: list[str] = []


def notebooks() -> None:
    """Put the notebooks among the pages: with their outputs if `make notebooks` has run, else as they are stored."""
    folder = HERE / "tutorials"
    for old in folder.glob("*.ipynb"):
        old.unlink()
    for stored in sorted((ROOT / "notebooks").glob("*.ipynb")):
        executed = ROOT / "build" / "notebooks" / stored.name
        shutil.copyfile(executed if executed.exists() else stored, folder / stored.name)


notebooks()
