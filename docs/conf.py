"""Build of the documentation: `sphinx-build -W -b html docs docs/_build/html`.

Needs the station installed with its `docs` extra. Nothing that a page shows is fetched from
elsewhere when it is viewed.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from station import __version__

project = "Inertial Station"
author = "the Inertial Station authors"
version = release = __version__
language = "en"

extensions = ["myst_parser", "mathml"]
exclude_patterns = ["_build", "_ext", "from_code"]
source_suffix = {".md": "markdown"}
nitpicky = True

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

html_theme = "alabaster"
html_title = f"{project} {release}"
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "description": "Calibration test station for inertial sensors",
    "fixed_sidebar": False,
    "page_width": "1080px",
    "sidebar_width": "240px",
    "font_family": "sans-serif",
    "head_font_family": "sans-serif",
    "show_powered_by": False,
}
html_sidebars = {"**": ["about.html", "searchfield.html", "navigation.html"]}
