"""Check HTML pages without a browser: `python3 -m tests.study.pages PATH ...`.

A path is a page or a folder of pages, e.g. the site. The check reports links and anchors without a
target, images that are missing or have no alternative text, files loaded from other sites, and
unrendered template code, LaTeX or Markdown, and doubled words in the text. It needs only Python's
standard library.
"""

import re
import sys
import tempfile
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

CHANGELOG = Path(__file__).parents[2] / "CHANGELOG.md"
URL_ATTRIBUTES = ("href", "src", "srcset")
VERBATIM_TAGS = {"code", "pre", "script", "style", "annotation", "textarea"}
TEXT_FAULT_PATTERNS = {
    "a template": re.compile(r"\{\{|\{%|%\}|\{#|\bUndefined\b"),
    "LaTeX": re.compile(r"\\(?:[A-Za-z]{2,}|[,;!({[])|\$\$|\$\\"),
    "Markdown": re.compile(r"\]\((?:https?:|\.\./|\w+\.md)|^```", re.MULTILINE),
    "a doubled word": re.compile(r"(?<![\w-])([A-Za-z]{2,}) \1\b"),
}

PAGE_BODIES_BY_FAULT = {
    "link leads nowhere": '<a href="nowhere.html">x</a>',
    "anchor leads nowhere": '<a href="#nowhere">x</a>',
    "image is missing": '<img src="nowhere.png" alt="x">',
    "no alternative text": '<img src="data:image/png;base64,AAAA">',
    "comes from elsewhere": '<script src="https://example.org/x.js"></script>',
    "text has a template": "<p>{{ value }}</p>",
    "text has LaTeX": r"<p>\textstyle x</p>",
    "text has Markdown": "<p>[x](../x.md)</p>",
    "text has a doubled word": '<p>as in section <a href="#a" id="a">section 1</a></p>',
}
"""Map from each fault that the check has to report to the body of a page with this fault."""


class Page(HTMLParser):
    """Tags of an HTML page with their attributes, and its text without code and formulas."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._verbatim = 0
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._verbatim += tag in VERBATIM_TAGS

    def handle_endtag(self, tag: str) -> None:
        self._verbatim -= tag in VERBATIM_TAGS

    def handle_data(self, data: str) -> None:
        if not self._verbatim:
            self.text += data

    def tag_attributes(self, tag: str) -> list[dict[str, str | None]]:
        """Return the attributes of all tags with a given name."""
        return [attributes for name, attributes in self.tags if name == tag]

    def attribute_values(self, *names: str, tags: tuple[str, ...] = ()) -> set[str]:
        """Return the nonempty values of the named attributes, in all tags or only in `tags`."""
        return {
            value
            for tag, attributes in self.tags
            if not tags or tag in tags
            for key in names
            if (value := attributes.get(key))
        }


def find_faults(folder: Path, chosen_paths: list[Path] | None = None) -> list[str]:
    """Return one line for each fault of all pages in a folder, or of the chosen pages only."""
    paths = sorted(folder.rglob("*.html")) if chosen_paths is None else chosen_paths
    pages = {path: Page(path.read_text("utf-8")) for path in paths}
    return [
        f"{path.relative_to(folder)}: {fault}"
        for path, page in pages.items()
        for fault in _find_page_faults(path, page, pages)
    ]


def _find_page_faults(path: Path, page: Page, pages: dict[Path, Page]) -> list[str]:
    images_without_text = {
        str(image.get("src"))[:60] for image in page.tag_attributes("img") if not image.get("alt")
    }
    faults = [f"no alternative text: {image}" for image in sorted(images_without_text)]
    loaded_references = page.attribute_values(
        *URL_ATTRIBUTES, tags=("script", "img", "link", "source")
    )
    image_references = page.attribute_values(*URL_ATTRIBUTES, tags=("img", "source"))
    for reference in sorted(page.attribute_values(*URL_ATTRIBUTES)):
        parts = urlsplit(reference)
        if parts.scheme or parts.netloc:
            if reference in loaded_references and parts.scheme != "data":
                faults.append(f"{reference} comes from elsewhere")
            continue
        file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        anchor = unquote(parts.fragment)
        if not file.is_file():
            fault_kind = (
                "image is missing" if reference in image_references else "link leads nowhere"
            )
            faults.append(f"{fault_kind}: {reference}")
        elif anchor and file in pages and anchor not in pages[file].attribute_values("id", "name"):
            faults.append(f"anchor leads nowhere: {reference}")
    for kind, pattern in TEXT_FAULT_PATTERNS.items():
        if leftover := pattern.search(page.text):
            context = page.text[max(0, leftover.start() - 30) : leftover.end() + 30]
            faults.append(f"text has {kind}: {' '.join(context.split())}")
    return faults


def find_search_and_change_faults(folder: Path, changelog: str) -> list[str]:
    """Return a line for each page of a site without search box, and for each change not shown.

    Args:
        folder: Folder of the site.
        changelog: Text of the file of changes, in Markdown.
    """
    faults = []
    for path in sorted(folder.rglob("*.html")):
        boxes = [
            attributes
            for attributes in Page(path.read_text("utf-8")).tag_attributes("input")
            if attributes.get("name") == "q" and attributes.get("aria-label")
        ]
        if not boxes:
            faults.append(f"{path.relative_to(folder)}: there is no search box with a label")
    changes = folder / "changes.html"
    html = changes.read_text("utf-8") if changes.is_file() else ""
    shown_text = _keep_letters_and_digits(re.sub(r"<[^>]+>", "", html))
    for bullet in re.findall(r"^- (.+(?:\n  .+)*)", changelog, re.MULTILINE):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", bullet)
        if _keep_letters_and_digits(text) not in shown_text:
            faults.append(f"changes.html: does not show {bullet[:60]!r}")
    return faults


def _keep_letters_and_digits(text: str) -> str:
    return re.sub(r"[\W_]", "", unescape(text))


def list_undetected_fault_kinds() -> list[str]:
    """Return the kinds of faults that `find_faults` misses on pages made with such a fault."""
    undetected_faults = []
    with tempfile.TemporaryDirectory() as name:
        page = Path(name) / "page.html"
        for fault, body in PAGE_BODIES_BY_FAULT.items():
            page.write_text(f"<!doctype html><title>x</title>{body}", "utf-8")
            if not any(fault in line for line in find_faults(page.parent)):
                undetected_faults.append(fault)
    return undetected_faults


def main(paths: list[str]) -> int:
    """Check pages and folders of pages; return 1 if a fault is found or missed, otherwise 0."""
    messages = [
        f"the check does not see the fault {fault!r}" for fault in list_undetected_fault_kinds()
    ]
    for path in map(Path, paths):
        folder, chosen_paths = (path, None) if path.is_dir() else (path.parent, [path.resolve()])
        n_pages = len(list(path.rglob("*.html"))) if path.is_dir() else int(path.is_file())
        if not n_pages:
            messages.append(f"there is no page in {path}")
            continue
        faults = find_faults(folder.resolve(), chosen_paths)
        if (path / "search.html").is_file():
            faults += find_search_and_change_faults(folder, CHANGELOG.read_text("utf-8"))
        messages += faults
        print(f"pages: {path}: {n_pages} pages, {len(faults)} faults")
    for line in messages:
        print(f"pages: {line}", file=sys.stderr)
    return int(bool(messages))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
