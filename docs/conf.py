"""Settings of the documentation site: `make site`."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import generate

project = "desat"
author = "the desat authors"
release = version = version_of("desat")
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",
]
exclude_patterns = ["**/*.template"]
html_theme = "furo"
html_title = "desat"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
live = Path(__file__).parents[1] / "build" / "live" / "page"
html_extra_path = (
    [str(live)] if live.is_dir() else []
)  # the loop of the first page, by `make site`
html_show_sphinx = html_show_copyright = html_copy_source = False
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
napoleon_google_docstring = False
napoleon_use_rtype = False
default_role = "code"
smartquotes = False  # they make a dash of --option
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
nitpicky = True
# types of other packages, of which no inventory is at hand
nitpick_ignore_regex = [("py:.*", ".*")]


def setup(app):
    app.connect("config-inited", lambda app, config: generate.write(Path(app.srcdir)))
    app.connect("source-read", generate.link)
