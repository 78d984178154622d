"""Settings of Sphinx:  python -m sphinx -W docs docs/_build"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import make_reference

from fmu_didim import __version__

make_reference.main()

project = "fmu_didim"
author = "the authors of fmu_didim"
version = release = __version__
extensions = ["myst_parser", "mathml"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"fmu_didim {version}"
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["math.css"]
html_copy_source = False
html_show_copyright = False
