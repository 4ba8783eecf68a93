"""Settings of the site that `make docs` builds into build/docs. Nothing is loaded from a network."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "gsid"
author = "the gsid authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "gsid_reference"]
exclude_patterns = ["_extensions", "requirements.txt"]

myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]

autodoc_typehints = "none"  # numpydoc sections have types, shapes and units
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

html_theme = "furo"
html_title = "gsid"
html_show_copyright = False
html_show_sourcelink = False
html_copy_source = False
