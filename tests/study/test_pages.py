"""Test that the page check detects faults and that docutils can typeset all formulas."""

import re
from pathlib import Path

import pytest
from docutils.utils.math import latex2mathml

from tests.study.pages import (
    PAGE_BODIES_BY_FAULT,
    find_faults,
    find_search_and_change_faults,
    list_undetected_fault_kinds,
    main,
)

DOCS_FOLDER = Path(__file__).parents[2] / "docs"
FORMULA_PATTERN = re.compile(r"\$\$(.+?)\$\$|(?<![\\$\w])\$([^$]+?)\$(?!\w)", re.DOTALL)


def test_page_check_detects_each_kind_of_fault(tmp_path):
    assert list_undetected_fault_kinds() == []
    for number, page_body in enumerate(PAGE_BODIES_BY_FAULT.values()):
        (tmp_path / f"{number}.html").write_text(f"<title>x</title>{page_body}")
    assert main([str(tmp_path)]) == 1
    assert len(find_faults(tmp_path)) >= len(PAGE_BODIES_BY_FAULT)


def test_page_check_detects_missing_search_boxes_and_changes(tmp_path):
    box = '<input name="q" aria-label="Search">'
    (tmp_path / "one.html").write_text(box)
    (tmp_path / "changes.html").write_text(f"{box}<li><p>All <code>a.b</code> is new; see how")
    changelog = "- All `a.b` is\n  new; see [how](docs/x.md)\n"
    assert find_search_and_change_faults(tmp_path, changelog) == []
    (tmp_path / "one.html").write_text('<input name="q">')
    assert find_search_and_change_faults(tmp_path, f"{changelog}- Less time\n") == [
        "one.html: there is no search box with a label",
        "changes.html: does not show 'Less time'",
    ]


def test_good_pages_pass_the_check_and_a_missing_page_fails(tmp_path, capsys):
    (tmp_path / "one.html").write_text(
        '<p id="a">x</p><a href="two.html#b">x</a><a href="#a">x</a>'
    )
    (tmp_path / "two.html").write_text(r'<p id="b"><code>{{ \alpha }}</code></p>')
    assert main([str(tmp_path)]) == 0
    assert main([str(tmp_path / "three.html")]) == 1
    assert "there is no page" in capsys.readouterr().err


@pytest.mark.parametrize("page", sorted(DOCS_FOLDER.rglob("*.md")), ids=lambda page: page.stem)
def test_formulas_of_the_docs_can_be_typeset_by_docutils(page):
    """Docutils, which typesets the site and supports only part of LaTeX, accepts all formulas."""
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text("utf-8"), flags=re.DOTALL)
    for block, inline in FORMULA_PATTERN.findall(text):
        # the site draws the root of a fraction over the numerator only
        assert not re.search(r"\\sqrt\{[^}]*\\[dt]?frac", block or inline)
        latex2mathml.tex2mathml((block or inline).strip(), as_block=bool(block))
