# SPDX-License-Identifier: Apache-2.0
"""
Settings of the documentation site; `make docs` builds it, and rosdoc2 does (rosdoc2.yaml).

The pages are the Markdown files of this folder as they are, read by MyST. What lies outside of it
(README and the like) and what is made from the code is written to ``generated/`` before each build
by scripts/docs_pages.py, which also says how links are followed.
"""
from pathlib import Path
import sys
import xml.etree.ElementTree as ElementTree


def checkout() -> Path:
    """Return the root of the repository; rosdoc2 runs this file from another folder."""
    for folder in (Path(__file__).resolve().parent.parent, *Path.cwd().resolve().parents):
        if (folder / 'docs' / 'conf.py').is_file() and (folder / 'package.xml').is_file():
            return folder
    import ballbot_ros
    return Path(ballbot_ros.__file__).resolve().parent.parent


ROOT = checkout()
sys.path[:0] = [str(ROOT), str(ROOT / 'scripts')]

import docs_mathml  # noqa: E402, I100, I202
import docs_pages  # noqa: E402

from ballbot_ros import __version__  # noqa: E402, I100

project = 'ballbot_ros'
author = ElementTree.parse(ROOT / 'package.xml').findtext('maintainer')
copyright = author  # noqa: A001
release = version = __version__

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'sphinxarg.ext',
              'sphinx_copybutton']
# rosdoc2 writes an index.rst where there is none; the first page is index.md.
exclude_patterns = ['_build', 'index.rst']
html_theme = 'furo'  # with a dark mode
html_title = f'ballbot_ros {version}'
html_static_path = [str(ROOT / 'docs' / '_static')]  # absolute, for rosdoc2
html_css_files = ['tables.css']
copybutton_exclude = '.linenos, .gp, .go'
html_show_sourcelink = False
highlight_language = 'none'  # of commands; other blocks name their language
smartquotes = False  # options begin with two dashes
html_math_renderer = 'mathml'

myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 4

autodoc_mock_imports = ['rclpy']
autodoc_member_order = 'bysource'
autodoc_typehints = 'none'
default_role = 'code'
napoleon_use_ivar = True

# Nothing is looked up on the network, so that a build is the same everywhere.
rosdoc2_settings = {'automatically_extend_intersphinx_mapping': False,
                    'enable_intersphinx': False, 'support_markdown': False}


def setup(app):
    """Connect what writes the generated pages and follows links."""
    docs_mathml.setup(app)
    app.connect('builder-inited', lambda app: docs_pages.write(Path(app.srcdir)))
    app.connect('source-read', docs_pages.source_read)
