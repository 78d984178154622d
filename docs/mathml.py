"""Formulas as MathML, which browsers draw themselves: no script, no fonts, no network."""

from __future__ import annotations

from functools import partial
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx


def _formula(writer: Any, node: nodes.Element, *, block: bool) -> None:
    """A formula that cannot be set is an error of the build."""
    formula = str(tex2mathml(node.astext(), as_block=block))
    writer.body.append(f'<div class="math">{formula}</div>' if block else formula)
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", (partial(_formula, block=False), None), (partial(_formula, block=True), None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
