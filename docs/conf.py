"""Settings of the documentation site; `make docs` builds it without network."""

import sys
from pathlib import Path

from amb_core import __version__

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

project = "AMB workbench"
author = "the authors of the AMB workbench"
copyright = "the authors of the AMB workbench, Apache License 2.0"
release = version = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_design",
    "sphinx_copybutton",
    "docs.generators.math",
    "docs.generators.site",
]
exclude_patterns = ["generators", "requirements.txt", "**/.ipynb_checkpoints"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = True
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "results" / "docs-notebooks")
nb_execution_timeout = 1800  # s; on a machine with much other work
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_execution_in_temp = True

default_role = "code"
smartquotes = False  # options such as --help stay as they are typed
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings give types with shapes and units
toc_object_entries_show_parents = "hide"
html_math_renderer = "mathml"
numpydoc_show_class_members = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
# Types of other packages, of private modules, and of modules that are not offered have no page to link to.
nitpick_ignore_regex = [("py:.*", ".*")]

html_theme = "furo"
html_title = "AMB workbench"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False
copybutton_prompt_text = r"\$ "
copybutton_only_copy_prompt_lines = False
