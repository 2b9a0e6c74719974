"""The pages of the guide: the code blocks of each page form a program that runs unchanged."""

import re
import shutil
from pathlib import Path

import pytest

from tests.run.test_tutorial import extract_python_code, run_program

ROOT = Path(__file__).parents[2]
DOCS_FOLDER = ROOT / "docs"
PAGES_WITH_CODE = sorted(
    path
    for path in DOCS_FOLDER.rglob("*.md")
    # the tutorial is tested by test_tutorial
    if "```python" in path.read_text() and path.name != "your-own-problem.md"
)
# pages and folders of the site that are no sources of the guide
GENERATED_PAGES = ("gallery", "reference", "evidence", "report", "changes")


@pytest.mark.parametrize("page", PAGES_WITH_CODE, ids=lambda page: page.stem)
def test_code_of_the_page_runs(page, tmp_path):
    for name in ("gasket.msh", "plate.inp"):
        shutil.copy(ROOT / "examples" / name, tmp_path)
    run_program(extract_python_code(page), tmp_path / "program.py")


def test_every_how_to_page_is_in_the_index():
    pages = {path.stem for path in (DOCS_FOLDER / "how-to").glob("*.md")} - {"index"}
    listed = (DOCS_FOLDER / "how-to" / "index.md").read_text()
    assert len(pages) >= 16
    assert all(f"\n{page}\n" in listed for page in pages)


def test_links_within_the_guide_lead_to_existing_pages():
    """All links within the guide lead to existing pages.

    Links to generated pages are checked by the tests of the site.
    """
    for page in DOCS_FOLDER.rglob("*.md"):
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
            if target.removeprefix("../").split("/")[0] in GENERATED_PAGES:
                continue
            path = page.parent / target
            assert path.is_file() or path.with_suffix(".md").is_file(), f"{page.name}: {target}"


def find_heading_anchors(page):
    """Return the anchors that MyST generates from the headings of a page."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_anchors_within_the_guide_lead_to_headings():
    """All anchors in links within the guide lead to headings.

    An anchor in a link must either follow a complete file name or stand alone.
    """
    checked = 0
    for page in DOCS_FOLDER.rglob("*.md"):
        for target, anchor in re.findall(r"\]\(([^)#:]*)#([^)]*)\)", page.read_text()):
            path = page.parent / target if target else page
            assert path.is_file(), f"{page.name}: {target}#{anchor}"
            assert anchor in find_heading_anchors(path), f"{page.name}: {target}#{anchor}"
            checked += 1
    assert checked > 4
