"""Convert Markdown with formulas to HTML for the report and the site.

Texts are written in CommonMark with tables and with LaTeX formulas between dollar signs.
markdown-it converts the text, and the LaTeX converter of Docutils converts the formulas to HTML.
The PDF therefore requires neither scripts nor images of formulas.
"""

import re
from functools import cache

from docutils.utils.math.math2html import math2html
from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup
from mdit_py_plugins.dollarmath import dollarmath_plugin

_RIGHT_ALIGNED_STYLE = "text-align:right"


def render_markdown(text: str) -> Markup:
    """Convert a Markdown text to HTML.

    The first column of a table contains row headers, and columns of numbers are right-aligned.
    """
    converter = _create_markdown_converter()
    tokens = converter.parse(str(text))
    _mark_table_headers_and_numbers(tokens)
    return Markup(converter.renderer.render(tokens, converter.options, {}))


def render_table_head_and_body(text: str) -> Markup:
    """Convert a Markdown table to HTML without the enclosing `table` element.

    Returns:
        The `thead` and `tbody` elements.

    Raises:
        ValueError: If the text is not a single table.
    """
    html = render_markdown(text).strip()
    match = re.fullmatch(r"<table>\n(.*)\n</table>", html, re.DOTALL)
    if match is None:
        raise ValueError(f"this is no Markdown table: {text[:200]}")
    return Markup(match[1])


@cache
def _create_markdown_converter() -> MarkdownIt:
    converter = MarkdownIt("commonmark", {"html": True}).enable("table")
    converter.use(dollarmath_plugin, double_inline=False, renderer=_render_formula_as_html)
    converter.add_render_rule(
        "math_inline", lambda _, tokens, i, *__: _render_formula_as_html(tokens[i].content)
    )
    converter.add_render_rule("math_block", _render_display_formula_as_paragraph)
    return converter


def _render_display_formula_as_paragraph(
    _: object, tokens: list[Token], i: int, *__: object
) -> str:
    return f'<p class="formula">{_render_formula_as_html(tokens[i].content)}</p>\n'


@cache
def _render_formula_as_html(latex: str, *_: object) -> str:
    html = str(math2html(latex.strip())).strip()
    html = re.sub(r"\s?\N{FRACTION SLASH}\s?", "/", html)  # possibly surrounded by thin spaces
    return re.sub(r"(<su[pb][^>]*>)\s?\N{MINUS SIGN}\s?", "\\1\N{MINUS SIGN}", html)


def _mark_table_headers_and_numbers(tokens: list[Token]) -> None:
    """Mark header cells by `<th scope>` and cells of numbers by the class "n", in place.

    Headers are the cells of the first row and of the first column. A cell contains a number if its
    column is right-aligned in Markdown.
    """
    in_head, is_first_cell = False, False
    for token in tokens:
        if token.type in ("thead_open", "thead_close"):
            in_head = token.type == "thead_open"
        elif token.type == "tr_open":
            is_first_cell = True
        elif token.type in ("th_open", "td_open"):
            is_number = token.attrs.pop("style", "") == _RIGHT_ALIGNED_STYLE
            if in_head or is_first_cell:
                token.tag = "th"
                token.attrSet("scope", "col" if in_head else "row")
            if is_number:
                token.attrSet("class", "n")
        elif token.type == "td_close":
            token.tag = "th" if is_first_cell else "td"
            is_first_cell = False
