# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sphinx: the documentation of squealx, built by ``make docs`` without network."""

import sys
from importlib.metadata import version as package_version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from mpi4py import MPI  # noqa: F401  the MPI library first, which PETSc is linked with

import pages
from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

project, author, copyright = "squealx", "The squealx authors", "The squealx authors"
version = release = package_version("squealx")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 3

html_theme = "furo"  # light and dark, narrow and wide, all of its files its own
html_title = f"squealx {version}"
html_copy_source = False

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_use_ivar = True

pages.write(Path(__file__).parent / "made")

html_math_renderer = "mathml"  # browsers draw it themselves; MathJax would come from the network


def mathml(translator, node):
    """Write the formula of a docstring as MathML."""
    block = isinstance(node, nodes.math_block)
    translator.body.append(tex2mathml(node.astext(), as_block=block))
    raise nodes.SkipNode


def setup(app):
    """Name the renderer of formulas."""
    app.add_html_math_renderer("mathml", (mathml, None), (mathml, None))
