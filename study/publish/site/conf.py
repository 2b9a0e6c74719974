"""Configuration of Sphinx for the website; Sphinx reads a copy of this file among the sources."""

import ast
import re
from pathlib import Path

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

import pw_elements
from study.publish.site.mathematics import typeset_plain_text_mathematics
from study.publish.site.search import add_report_to_search_index

project = "pw-elements"
author = "pw-elements developers"
version = release = pw_elements.__version__
html_title = f"pw-elements {version}"
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css", "formula.css"]
html_js_files = ["search.js"]
html_search_scorer = str(Path(__file__).with_name("search_scorer.js"))
templates_path = ["_templates"]
html_show_copyright = html_show_sphinx = html_copy_source = html_show_sourcelink = False
html_theme_options = {
    "announcement": "search box",  # the theme has a place above the page, which `page.html` fills
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
default_role = "py:obj"  # `name` becomes a link if it has a page, and code otherwise
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 80
autodoc_default_options = {"members": True}
napoleon_use_rtype = False
html_math_renderer = "mathml"

_SECTION_HEADING = re.compile(r"(Args|Attributes|Raises|Returns|Yields):$")

_CODE_WITH_SUFFIX = re.compile(r"`([^`]+)`(?=\w)")  # such as `name`s, which requires a separator


def convert_docstring_to_rst(
    app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Convert a docstring to reStructuredText, in place (handler of `autodoc-process-docstring`).

    Indented blocks outside sections such as Args become code if they are Python, otherwise
    formulas. The arguments are those that Sphinx passes; `lines` contains the docstring.
    """
    converted_lines: list[str] = []
    block: list[str] = []
    section = previous_line = ""
    for line in [*lines, ""]:
        if line.startswith("    ") and not section and (block or not previous_line):
            block.append(line)
            continue
        if block and line:
            converted_lines += _format_code_or_formula_block(block)
            block = []
        if line and not line.startswith(" "):
            section = line if _SECTION_HEADING.match(line) else ""
        if block:
            block.append(line)
        else:
            converted_lines.append(_format_prose_line(line, bool(section)))
        previous_line = line
    lines[:] = [*converted_lines, *_format_code_or_formula_block(block)]


def _format_code_or_formula_block(block: list[str]) -> list[str]:
    """Format an indented block as code if it is valid Python, otherwise as lines of formulas.

    Args:
        block: Lines of the block; if there are none, the result is empty.
    """
    try:
        ast.parse("\n".join(line.removeprefix("    ") for line in block))
    except SyntaxError:
        formulas = [_typeset_mathematics_as_rst(line.replace("|", r"\|")) for line in block if line]
        return [
            ".. rst-class:: formula",
            "",
            *(f"| {_widen_spaces_between_formulas(line)}" for line in formulas),
            "",
        ]
    return [".. code-block:: python", "", *block, ""] if block else []


def _widen_spaces_between_formulas(formulas: str) -> str:
    return re.sub(r" {2,}", " \N{EM SPACE} ", formulas.strip())


def _format_prose_line(line: str, in_docstring_section: bool) -> str:
    """Typeset the mathematics in a line of prose, except in code between backticks.

    Args:
        line: Line of a docstring.
        in_docstring_section: Whether the line is in a section such as Args, where the name before a
            colon is left unchanged.
    """
    name_match = re.match(r"    [\w, ]+: ", line) if in_docstring_section else None
    prefix = name_match[0] if name_match else ""
    parts = re.split(r"(`[^`]*`)", line[len(prefix) :].replace("|", r"\|"))
    text = "".join(
        part if part.startswith("`") else _typeset_mathematics_as_rst(part) for part in parts
    )
    return prefix + _CODE_WITH_SUFFIX.sub(r"`\1`\\ ", text)


def _typeset_mathematics_as_rst(text: str) -> str:
    return typeset_plain_text_mathematics(text, "\\ :sub:`{}`\\ ", "\\ :sup:`{}`\\ ")


def shorten_array_types(
    app: Sphinx,
    what: str,
    name: str,
    thing: object,
    options: object,
    signature: str | None,
    return_annotation: str | None,
) -> tuple[str | None, str | None]:
    """Shorten array types in a signature to `numpy.ndarray`, as an event handler of Sphinx.

    Type parameters for shape and entries are omitted. The arguments are those that Sphinx passes.
    """

    def shorten_array_types_in_text(text: str | None) -> str | None:
        if text is None:
            return None
        text = re.sub(
            r"~?numpy\.ndarray\[tuple\[.*?\], ~?numpy\.dtype\[.*?\]\]", "~numpy.ndarray", text
        )
        return re.sub(r"(~numpy\.ndarray)(?: \| ~numpy\.ndarray)+", r"\1", text)

    return shorten_array_types_in_text(signature), shorten_array_types_in_text(return_annotation)


def _write_inline_mathml(translator: HTML5Translator, node: nodes.Element) -> None:
    """Write an inline formula as MathML, which browsers display without scripts."""
    translator.body.append(str(latex2mathml.tex2mathml(node.astext(), as_block=False)))
    raise nodes.SkipNode


def _write_display_mathml(translator: HTML5Translator, node: nodes.Element) -> None:
    formula = latex2mathml.tex2mathml(node.astext(), as_block=True)
    translator.body.append(f'<div class="formula">{formula}</div>')
    raise nodes.SkipNode


def _fix_source_backlinks(
    app: Sphinx, page: str, template: str, context: dict[str, str], tree: object
) -> None:
    """Correct links from pages of source code to the reference (handler of `html-page-context`).

    Sphinx links to the module that defines a name, but the name may be documented in another
    module.
    """
    if page.startswith("_modules/"):
        link = r"(reference/([\w.]+?)\.(\w+)\.html#)[\w.]+?\.\3(?=[.\"])"
        context["body"] = re.sub(link, r"\1\2.\3", context["body"])


def setup(app: Sphinx) -> None:
    """Register the extensions of Sphinx that this module defines."""
    renderers = {
        "inline_renderers": (_write_inline_mathml, None),
        "block_renderers": (_write_display_mathml, None),
    }
    app.add_html_math_renderer("mathml", **renderers)
    app.connect("autodoc-process-docstring", convert_docstring_to_rst, priority=100)
    app.connect("autodoc-process-signature", shorten_array_types)
    app.connect("html-page-context", _fix_source_backlinks)
    app.connect("build-finished", add_report_to_search_index)
