"""Sphinx configuration of the documentation; `make docs` builds it, with warnings as errors."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import generate  # noqa: E402
import tables  # noqa: E402

from wheelchair_gym import __version__  # noqa: E402

generate.write_pages(HERE / "generated")
if stale := tables.stale():
    sys.exit(f"results measured with other code than the release's: {', '.join(stale)}")

project = "wheelchair_gym"
author = "the wheelchair_gym developers"
copyright = "the wheelchair_gym developers, MIT licence"
version = release = __version__

extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["generated/fragments/*"]  # pages include them
myst_enable_extensions = ["deflist", "fieldlist", "colon_fence"]
myst_heading_anchors = 3
# Nothing is fetched: links to other sites are not checked, and there is no other project's index.
nitpicky = False
highlight_language = "none"  # of blocks that name none: drawings
add_module_names = False
toc_object_entries_show_parents = "hide"
python_maximum_signature_line_length = 88

html_theme = "furo"
html_title = f"wheelchair_gym {version}"
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
