"""The guide's pages: each one's code blocks are a program, which runs as it stands."""

import re
import shutil
from pathlib import Path

import pytest

from tests.run.test_tutorial import code_of, run_program

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PROGRAMS = sorted(
    path
    for path in DOCS.rglob("*.md")
    if "```python" in path.read_text() and path.name != "your-own-problem.md"  # has its own tests
)


@pytest.mark.parametrize("page", PROGRAMS, ids=lambda page: page.stem)
def test_code_of_the_page_runs(page, tmp_path):
    for name in ("gasket.msh", "plate.inp"):
        shutil.copy(ROOT / "examples" / name, tmp_path)
    run_program(code_of(page), tmp_path / "program.py")


def test_every_how_to_is_in_the_index():
    pages = {path.stem for path in (DOCS / "how-to").glob("*.md")} - {"index"}
    listed = (DOCS / "how-to" / "index.md").read_text()
    assert len(pages) >= 16
    assert all(f"\n{page}\n" in listed for page in pages)


def test_links_within_the_guide_lead_somewhere():
    """Pages that are made (gallery, reference, evidence) are looked at in the browser."""
    for page in DOCS.rglob("*.md"):
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
            if target.removeprefix("../").split("/")[0] in ("gallery", "reference", "evidence"):
                continue
            path = page.parent / target
            assert path.is_file() or path.with_suffix(".md").is_file(), f"{page.name}: {target}"


def heading_anchors(page):
    """Return the anchors that MyST makes of a page's headings."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


def test_anchors_within_the_guide_lead_to_headings():
    """Only a file's name with its ending, or none, may stand before an anchor."""
    checked = 0
    for page in DOCS.rglob("*.md"):
        for target, anchor in re.findall(r"\]\(([^)#:]*)#([^)]*)\)", page.read_text()):
            path = page.parent / target if target else page
            assert path.is_file(), f"{page.name}: {target}#{anchor}"
            assert anchor in heading_anchors(path), f"{page.name}: {target}#{anchor}"
            checked += 1
    assert checked > 4
