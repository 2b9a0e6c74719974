"""Sphinx' settings; it reads this file from the folder of the sources."""

import re

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

import pw_elements

project = "pw-elements"
author = "pw-elements developers"
version = release = pw_elements.__version__
html_title = f"pw-elements {version}"
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_copyright = html_show_sphinx = html_copy_source = html_show_sourcelink = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0072B2", "color-brand-content": "#0b57a4"},
    "dark_css_variables": {"color-brand-primary": "#56B4E9", "color-brand-content": "#7cc4f0"},
}
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_design",
    "sphinx_copybutton",
]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "attrs_inline"]
myst_heading_anchors = 3
default_role = "py:obj"  # `name` is a link where there is a page of it, code elsewhere
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 80
autodoc_default_options = {"members": True}
napoleon_use_rtype = False
html_math_renderer = "mathml"

_SECTION = re.compile(r"(Args|Attributes|Raises|Returns|Yields):$")

_PLURAL = re.compile(r"`([^`]+)`(?=\w)")  # as in `name`s, which needs a separator


def readable(
    app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Make reStructuredText of a docstring: code of what is indented, |x| and `names` in prose."""
    made: list[str] = []
    section = before = ""
    inside = False
    for line in lines:
        if line and not line.startswith(" "):
            inside, section = False, line if _SECTION.match(line) else ""
        elif line.startswith("    ") and not (inside or section or before):
            made += [".. code-block:: python", ""]
            inside = True
        made.append(line if inside else _PLURAL.sub(r"`\1`\\ ", line.replace("|", r"\|")))
        before = line
    lines[:] = made


def _inline(page: HTML5Translator, node: nodes.Element) -> None:
    """Write a formula as MathML, which browsers know without any script."""
    page.body.append(str(latex2mathml.tex2mathml(node.astext(), as_block=False)))
    raise nodes.SkipNode


def _block(page: HTML5Translator, node: nodes.Element) -> None:
    formula = latex2mathml.tex2mathml(node.astext(), as_block=True)
    page.body.append(f'<div class="formula">{formula}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Add what Sphinx does not do by itself."""
    ways = {"inline_renderers": (_inline, None), "block_renderers": (_block, None)}
    app.add_html_math_renderer("mathml", **ways)
    app.connect("autodoc-process-docstring", readable, priority=100)
