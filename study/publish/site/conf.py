"""Sphinx' settings; it reads this file from the folder of the sources."""

import ast
import re

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

import pw_elements
from study.publish.site.mathematics import typeset

project = "pw-elements"
author = "pw-elements developers"
version = release = pw_elements.__version__
html_title = f"pw-elements {version}"
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css", "formula.css"]
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
    """Make reStructuredText of a docstring: code or formulas of what is indented, and prose."""
    made: list[str] = []
    block: list[str] = []
    section = before = ""
    for line in [*lines, ""]:
        if line.startswith("    ") and not section and (block or not before):
            block.append(line)
            continue
        if block and line:
            made += _shown(block)
            block = []
        if line and not line.startswith(" "):
            section = line if _SECTION.match(line) else ""
        if block:
            block.append(line)
        else:
            made.append(_prose(line, bool(section)))
        before = line
    lines[:] = [*made, *_shown(block)]


def _shown(block: list[str]) -> list[str]:
    """Write an indented block: Python as such, all else as a formula."""
    try:
        ast.parse("\n".join(line.removeprefix("    ") for line in block))
    except SyntaxError:
        formulas = [_marked(line.replace("|", r"\|")) for line in block if line]
        return [".. rst-class:: formula", "", *(f"| {_apart(line)}" for line in formulas), ""]
    return [".. code-block:: python", "", *block, ""] if block else []


def _apart(formulas: str) -> str:
    return re.sub(r" {2,}", " \N{EM SPACE} ", formulas.strip())


def _prose(line: str, section: bool) -> str:
    """Write a line of text; in a section, the name before a colon stays as it is."""
    name = re.match(r"    [\w, ]+: ", line) if section else None
    head = name[0] if name else ""
    parts = re.split(r"(`[^`]*`)", line[len(head) :].replace("|", r"\|"))
    text = "".join(part if part.startswith("`") else _marked(part) for part in parts)
    return head + _PLURAL.sub(r"`\1`\\ ", text)


def _marked(text: str) -> str:
    return typeset(text, "\\ :sub:`{}`\\ ", "\\ :sup:`{}`\\ ")


def short_types(
    app: Sphinx,
    what: str,
    name: str,
    thing: object,
    options: object,
    signature: str | None,
    returned: str | None,
) -> tuple[str | None, str | None]:
    """Write arrays' types without the types of their shapes and entries."""

    def shorter(text: str | None) -> str | None:
        if text is None:
            return None
        text = re.sub(
            r"~?numpy\.ndarray\[tuple\[.*?\], ~?numpy\.dtype\[.*?\]\]", "~numpy.ndarray", text
        )
        return re.sub(r"(~numpy\.ndarray)(?: \| ~numpy\.ndarray)+", r"\1", text)

    return shorter(signature), shorter(returned)


def _inline(page: HTML5Translator, node: nodes.Element) -> None:
    """Write a formula as MathML, which browsers know without any script."""
    page.body.append(str(latex2mathml.tex2mathml(node.astext(), as_block=False)))
    raise nodes.SkipNode


def _block(page: HTML5Translator, node: nodes.Element) -> None:
    formula = latex2mathml.tex2mathml(node.astext(), as_block=True)
    page.body.append(f'<div class="formula">{formula}</div>')
    raise nodes.SkipNode


def _back(app: Sphinx, page: str, template: str, context: dict[str, str], tree: object) -> None:
    """Point sources' links at names as their pages have them, which may be of another face."""
    if page.startswith("_modules/"):
        link = r"(reference/([\w.]+?)\.(\w+)\.html#)[\w.]+?\.\3(?=[.\"])"
        context["body"] = re.sub(link, r"\1\2.\3", context["body"])


def setup(app: Sphinx) -> None:
    """Add what Sphinx does not do by itself."""
    ways = {"inline_renderers": (_inline, None), "block_renderers": (_block, None)}
    app.add_html_math_renderer("mathml", **ways)
    app.connect("autodoc-process-docstring", readable, priority=100)
    app.connect("autodoc-process-signature", short_types)
    app.connect("html-page-context", _back)
