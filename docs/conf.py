"""Settings of Sphinx for the documentation site; `make docs` builds it."""

from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()

project = "ellipseg_ros"
author = MANIFEST.findtext("maintainer")
copyright = author
version = release = MANIFEST.findtext("version")

extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_tools"]
nitpicky = True

html_theme = "furo"
html_title = f"ellipseg_ros {release}"
html_show_copyright = False
html_static_path: list[str] = []
