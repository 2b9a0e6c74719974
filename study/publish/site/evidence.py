"""The evidence: a sheet for each section, an index of the paper's items, and all claims.

A sheet has what is computed and with what reference, figures, and a table of quantities with their
reference, error and tolerance. Texts are those of the pages and of `study/publish/texts`; numbers
come from stored results and judged claims.
"""

import html
import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from markupsafe import Markup

from study.judge import claims as judged
from study.judge.facts import COMPUTED, ROWS
from study.model.vocabulary import ELEMENTS
from study.paper.items import ITEMS, TITLES_WITHOUT_PAGE, Item
from study.publish.site import mathematics
from study.publish.texts import PAPERS, Place, Texts, provenance, section_facts
from study.publish.texts.numbers import short
from study.publish.texts.statements import by_fact, names_section
from study.run.cases import SECTIONS, find_page_source, title
from study.run.store import CorruptResult, MissingResult, MissingScalar, Results, StudyError

HERE = Path(__file__).parent
REPORT = ("report.html", "report.pdf")
ROOT = HERE.parents[2]
PARTS = ("geometry", "mesh", "material", "supports", "load", "reference", "uncertainty")
GROUPS = {
    "The paper's sections": [s for s in SECTIONS if s[0].isdigit() or s == "I"],
    "Verification": [
        s for s in SECTIONS if not s[0].isdigit() and s not in ("I", "P", "Q", "W", "K")
    ],
    "Other methods and codes, and cost": ["Q", "W", "P", "K"],
}


# Sections of the paper whose statements a sheet judges, if other than its own
JUDGED = {"I": ("1",), "3": ("3", "4", "6")}
# The texts, of the report's, that sum up
SUMMARY = {
    "evidence": "What was tested, and with which result",
    "unknown": "What could not be known, and errata of the paper",
}


def write(results: Results, source_folder: Path) -> list[str]:
    """Write the evidence's pages; return what is missing."""
    pages = source_folder / "evidence"
    pages.mkdir()
    stored = [section for section in SECTIONS if results.cases(section)]
    first = _Sheets(results, {}, strict=False)
    first.pages(stored)
    texts = _Sheets(results, first.known, strict=not first.incomplete)
    figures = source_folder / "_static" / "figures"
    figures.mkdir(parents=True)
    for name in texts.figures:
        for path in (results.folder / "figures").glob(f"{name}.*svg"):
            shutil.copy(path, figures)
    for name, page in texts.pages(stored).items():
        (pages / f"{name}.md").write_text(page, encoding="utf-8")
    (pages / "figures-and-tables.md").write_text(texts.items(stored), encoding="utf-8")
    (pages / "claims.md").write_text(texts.all_claims(stored), encoding="utf-8")
    (pages / "facts.md").write_text(texts.all_facts(), encoding="utf-8")
    (pages / "index.md").write_text(texts.index(stored), encoding="utf-8")
    which = source_folder / "which-way.md"
    which.write_text(which.read_text("utf-8") + "\n" + texts.decision(), encoding="utf-8")
    return texts.incomplete


def copy_data(results: Results, pages: Path) -> list[str]:
    """Put the files of all readable results and the report beside the pages, which refer to them.

    Returns:
        What is missing.
    """
    missing = []
    for name in REPORT:
        if (path := results.folder / name).is_file():
            shutil.copy(path, pages)
        else:
            missing.append(f"there is no {name}: run ./run study")
    for section in SECTIONS:
        folder = pages / "data" / section
        folder.mkdir(parents=True)
        missing += results.corrupt_results(section).values()
        for stored in results.readable_results(section):
            endings = ("json", "npz") if stored.curves else ("json",)
            for ending in endings:
                shutil.copy(results.folder / section / f"{stored.case}.{ending}", folder)
    return missing


class _Sheets(Texts):
    """Texts as pages of the site.

    Args:
        results: What is shown.
        known: Places of figures, tables and sections, for what is referred to before it comes.
        strict: Whether all that is referred to is known.
    """

    def __init__(self, results: Results, known: dict[str, Place], strict: bool) -> None:
        sections = {one: Place(f"{one}.html", f"section {one}") for one in SECTIONS}
        sections |= {name: Place("paper.html", words) for name, words in SUMMARY.items()}
        super().__init__(results, [HERE], "sheet.html", sections | known, strict)
        self._page = ""
        self.environment.globals |= {"sheet": True, "claims_table": self.claims_table}
        filters: dict[str, Callable[..., Markup]] = {
            "typeset": typeset,
            "relation": _relation,
            "computed": _computed,
        }
        self.environment.filters |= filters

    def pages(self, sections: list[str]) -> dict[str, str]:
        """Return the pages of the sections, and that of the paper."""
        return {section: self.sheet(section) for section in sections} | {"paper": self.paper()}

    def sheet(self, section: str) -> str:
        """Return the page of a section."""
        name = mathematics.typeset(title(section), "{{sub}}`{}`")
        head = [f"# {section}: {name}", self._facts(section)]
        body = self._body(section, section)
        return "\n\n".join([*head, body, self._data(section)]) + "\n"

    def paper(self) -> str:
        """Return the page of what the paper is about and what of it holds."""
        self.numbers = {}
        parts = [f"## {head}\n\n{self._body('paper', name)}" for name, head in SUMMARY.items()]
        cited = _raw(self.render("cited.html"))
        return "\n\n".join(
            ["# The paper, and what of it holds", *parts, f"## References\n\n{cited}"]
        )

    def _body(self, page: str, name: str) -> str:
        if page == name:
            self.numbers = {}
        self._page = page
        before = dict(self.numbers)
        try:
            body = self.text(name)
        except (MissingResult, CorruptResult, MissingScalar) as missing:
            self.numbers = before  # its figures and tables are not shown
            self.incomplete.append(f"{name}: {missing}")
            body = Markup('<p class="note">This sheet is incomplete: {}.</p>').format(missing)
        mine = [n for n, entry in self.figures.items() if entry["section"] == name]
        body += Markup().join(self.figure(n) for n in mine if f'id="{n}"' not in body)
        self.known |= {**self.places(f"{page}.html"), **self.known}
        return _as_markdown(_linked(body, page))

    def ref(self, name: str) -> Markup:
        """Return a link to a figure, a table or a section, which may be on another page."""
        link = super().ref(name)
        page, inside, _ = self.known.get(name, Place("", "")).address.partition(".html#")
        return link + f" of section {page}" if inside and page != self._page else link

    def drawing(self, name: str) -> dict[str, Any] | None:
        """Return a figure's entry, with the addresses of the files that lie beside the pages."""
        if name not in self.figures:
            return None
        folder, entry = "../_static/figures", dict(self.figures[name])
        entry["uri"] = f"{folder}/{name}.svg"
        entry["narrow_uri"] = f"{folder}/{name}.narrow.svg" if "narrow" in entry else None
        return entry

    def claims_table(self, section: str) -> Markup:
        """Return the quantities of a sheet, with reference, error and tolerance.

        Pins are left out unless they differ.
        """
        rows = [row for one in JUDGED.get(section, (section,)) for row in self.claims_of(one)]
        shown = [row for row in rows if row["kind"] != "pin" or row["differs"]]
        return self.render("quantities.html", rows=shown) if shown else Markup()

    def all_claims(self, sections: list[str]) -> str:
        """Return the page of all claims and findings."""
        rows = [
            row | {"sections": [s for s in sections if names_section(row["source"], s)]}
            for row in self.claims
        ]
        page = self.render(
            "all_claims.html",
            rows=rows,
            grades=judged.GRADES,
            verdicts=dict.fromkeys(row["verdict"] for row in rows),
            sections=sections,
        )
        text = (
            "Statements of the paper, each with one grade, and findings of this study, each with "
            "the number it is judged by. Tolerances count in favour of the statement; each entry "
            "says whether its tolerance was set before or after the first value was seen."
        )
        return f"# Claims and findings\n\n{text}\n\n{_raw(page)}\n"

    def all_facts(self) -> str:
        """Return the page of the facts that the paper's statements rest on, and what turns them."""
        groups = by_fact([row for row in self.claims if row["fact"]])
        mutations = (*COMPUTED, *ROWS)
        page = self.render("all_facts.html", groups=groups, mutations=mutations)
        return f"# Facts\n\n{_as_markdown(page)}\n"

    def items(self, sections: list[str]) -> str:
        """Return the index of the paper's figures, tables and equations."""
        parts = ["# The paper's figures and tables"]
        for kind, head in (("figure", "Figures"), ("table", "Tables"), ("equation", "Equations")):
            mine = [self._item(item, sections) for item in ITEMS if item.kind == kind]
            parts += [f"## {head}", _raw(self.render("items.html", rows=mine, kind=kind))]
        return "\n\n".join(parts) + "\n"

    def index(self, sections: list[str]) -> str:
        """Return the page that lists all sheets."""
        parts = ["# Evidence", (HERE / "evidence.md").read_text("utf-8")]
        for group, members in GROUPS.items():
            rows = [self._summary(section) for section in members if section in sections]
            parts += [f"## {group}", _raw(self.render("sheets.html", rows=rows))]
        cases = [case for section in sections for case in self.results.readable_results(section)]
        parts.append(f"## Computed with\n\n{_raw(self.render('origin.html', **provenance(cases)))}")
        tree = "\n".join(["paper", "claims", "facts", "figures-and-tables", *sections])
        parts.append(f"```{{toctree}}\n:hidden:\n\n{tree}\n```")
        return "\n\n".join(parts) + "\n"

    def decision(self) -> str:
        """Return the table of what to use when, for a page beside the evidence's folder."""
        self.numbers = {}
        return _raw(str(self.text("decision")).replace('href="', 'href="evidence/'))

    def _facts(self, section: str) -> str:
        sheet = section_facts(section)
        if strange := sheet.keys() - {*PARTS}:
            raise StudyError(f"the facts of {section} have {', '.join(sorted(strange))}")
        path = find_page_source(section)
        cases = len(self.results.readable_results(section))
        rows = [(part.capitalize(), typeset(sheet[part])) for part in PARTS if part in sheet]
        rows += [
            ("Computed in", Markup("<code>{}</code>").format(path.relative_to(ROOT).as_posix())),
            ("Command", Markup("<code>./run study {}</code>").format(section)),
            ("Data", Markup('<a href="#data">{} results</a>').format(cases)),
        ]
        return _raw(self.render("facts.html", rows=rows))

    def _data(self, section: str) -> str:
        page = self.render(
            "data.html", section=section, cases=self.results.readable_results(section)
        )
        return f"## Data\n\n{_raw(page)}"

    def _summary(self, section: str) -> dict[str, Any]:
        verdicts: dict[str, list[str]] = {"paper": [], "finding": [], "pin": []}
        for row in self.claims_of(section):
            kind = "paper" if row["kind"] in judged.PAPER else row["kind"]
            verdicts[kind].append(row["verdict"])
        counts = {kind: (len(mine), mine.count("holds")) for kind, mine in verdicts.items()}
        drawn = [name for name, entry in self.figures.items() if entry["section"] == section]
        alt = self.figures[drawn[-1]]["alt"] if drawn else ""
        summary = {"id": section, "title": title(section), **counts}
        return summary | {"figure": drawn[-1:], "alt": alt}

    def _item(self, item: Item, sections: list[str]) -> dict[str, Any]:
        name = next((n for n in self.figures if _shows(n, item)), None)
        return {
            "item": item,
            "section": TITLES_WITHOUT_PAGE.get(item.section) or title(item.section),
            "sheet": item.section if item.section in sections else None,
            "drawn": name,
            "alt": self.figures[name]["alt"] if name else "",
        }


_KEYS = re.compile(rf"\b(?:{'|'.join(sorted(ELEMENTS, key=len, reverse=True))})\b(?!-)")


def typeset(text: str) -> Markup:
    """Return plain text as a page has it: mathematics as such, and names for elements' keys."""
    named = _KEYS.sub(lambda found: ELEMENTS[found[0]].name, html.escape(text, quote=False))
    return Markup(mathematics.typeset(named))


def _relation(sign: str) -> Markup:
    """Return the sign before a reference; none says that it is to be met."""
    return Markup("" if sign == "=" else typeset(f"{sign} "))


def _computed(row: dict[str, Any]) -> Markup:
    """Return a judged number with the digits that its comparison needs."""
    value, wanted, tol = row["measured"], row["value"], row["tol"]
    if row["relation"] != "=" or None in (value, wanted) or not tol:
        return short(value, 4)
    return short(value, _digits(value, tol))


def _digits(value: float, tol: float) -> int:
    """Return how many significant digits of a number end one place below a tolerance's first."""
    if not value:
        return 2
    above = math.floor(math.log10(abs(value))) - math.floor(math.log10(tol))
    return min(max(2 + above, 2), 8)


def _shows(name: str, item: Item) -> bool:
    """Tell whether a figure is an item of the paper, or one of several."""
    match = PAPERS.fullmatch(name)
    if not match or match[1] != item.kind[:3]:
        return False
    return int(match[2]) <= int(item.number) <= int(match[3] or match[2])


_SECTION = rf"(?:{'|'.join(re.escape(one) for one in sorted(SECTIONS, key=len, reverse=True))})"
_ONE = re.compile(rf"{_SECTION}(?![.\w])")
_NAMED = re.compile(rf"\bsections? {_SECTION}\b(?:(?:, | and | to ){_SECTION}\b)*")


def _linked(body: str, own: str = "") -> str:
    """Make links of the sections that a text names, but for the page's own."""

    def link(found: re.Match[str]) -> str:
        return found[0] if found[0] == own else f'<a href="{found[0]}.html">{found[0]}</a>'

    def links(found: re.Match[str]) -> str:
        word, _, names = found[0].partition(" ")
        return f"{word} {_ONE.sub(link, names)}"

    parts = re.split(r"(<a .*?</a>|<[^>]*>)", body, flags=re.DOTALL)
    return "".join(part if part.startswith("<") else _NAMED.sub(links, part) for part in parts)


def _as_markdown(body: str) -> str:
    """Make headings of a text Markdown's own, so that they are in contents and search."""
    parts = re.split(r"<h([34])>(.*?)</h\1>", body, flags=re.DOTALL)
    made = [_raw(parts[0])] if parts[0].strip() else []
    for level, heading, text in zip(parts[1::3], parts[2::3], parts[3::3], strict=True):
        words = html.unescape(re.sub(r"<[^>]+>", "", heading)).strip()
        made.append(f"{'#' * (int(level) - 1)} {words}")
        if text.strip():
            made.append(_raw(text))
    return "\n\n".join(made)


def _raw(page: str) -> str:
    return f"`````{{raw}} html\n{page}\n`````"
