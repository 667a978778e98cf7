"""How the documentation site is built: ``make docs``, or ``sphinx-build docs out/site``."""
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import gdmp_ros  # noqa: E402

project = 'gdmp_ros'
author = 'the gdmp_ros authors'
version = release = gdmp_ros.__version__
extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.viewcode']
source_suffix = {'.md': 'markdown', '.rst': 'restructuredtext'}
myst_enable_extensions = ['colon_fence']
myst_heading_anchors = 3
html_theme = 'furo'
html_title = 'gdmp_ros'
html_show_sphinx = False
html_static_path = ['_static']
html_css_files = ['tables.css']
html_extra_path = ['skill.schema.json']

#: A single `name` in a docstring is code.
default_role = 'code'
autodoc_member_order = 'bysource'
autodoc_typehints = 'description'
autodoc_typehints_description_target = 'documented'
autodoc_default_options = {'members': True, 'show-inheritance': True}


def skip_constants(_, what, name, obj, skip, options):
    """Leave constants of modules out: the page shows classes and functions."""
    return True if what == 'module' and name.isupper() else skip


def setup(app):
    """Connect the filter of autodoc."""
    app.connect('autodoc-skip-member', skip_constants)
