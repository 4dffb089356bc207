# SPDX-License-Identifier: Apache-2.0
"""Render the formulas of the site as MathML, which browsers display without scripts."""
from docutils.nodes import SkipNode
from docutils.utils.math import latex2mathml


def _markup(formula: str, block: bool) -> str:
    """Return the MathML of a formula in LaTeX."""
    try:
        return latex2mathml.tex2mathml(formula, as_block=block)
    except TypeError:  # docutils before 0.21, as in Ubuntu 24.04
        return latex2mathml.tex2mathml(formula, inline=not block)


def _inline(self, node):
    self.body.append(_markup(node.astext(), False))
    raise SkipNode


def _block(self, node):
    formula = _markup(node.astext(), True)
    self.body.append(f'<div class="math" style="margin: 1em 0">{formula}</div>\n')
    raise SkipNode


def setup(app):
    """Register the renderer with Sphinx."""
    app.add_html_math_renderer('mathml', (_inline, None), (_block, None))
