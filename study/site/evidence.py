"""The evidence: a sheet for each section, an index of the paper's items, and all claims.

A sheet has what is computed and with what reference, figures, and a table of quantities with their
reference, error and tolerance. Texts are those of `study/report/sections`; numbers come from stored
results and judged claims.
"""

import html
import math
import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from markupsafe import Markup

from study.core.cases import SECTIONS, title
from study.core.sources import source
from study.core.store import MissingResult, Results, StudyError
from study.judge import claims as judged
from study.paper.items import ITEMS, TITLES, Item
from study.report.numbers import short
from study.report.texts import Texts, names_section, provenance
from study.site import mathematics
from study.vocabulary import ELEMENTS

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
# What each sheet says at its head, in words
SHEETS: dict[str, dict[str, str]] = tomllib.loads((HERE / "sheets.toml").read_text("utf-8"))
PARTS = ("geometry", "mesh", "material", "supports", "load", "reference", "uncertainty")
GROUPS = {
    "The paper's sections": [s for s in SECTIONS if s[0].isdigit() or s == "I"],
    "Verification": [s for s in SECTIONS if not s[0].isdigit() and s not in ("I", "P", "K")],
    "Other codes, and cost": ["P", "K"],
}


def write(results: Results, source_folder: Path) -> list[str]:
    """Write the evidence's pages; return what is missing."""
    pages = source_folder / "evidence"
    pages.mkdir()
    texts = _Sheets(results)
    figures = source_folder / "_static" / "figures"
    figures.mkdir(parents=True)
    for name in texts.figures:
        for path in (results.folder / "figures").glob(f"{name}.*svg"):
            shutil.copy(path, figures)
    stored = [section for section in SECTIONS if results.cases(section)]
    for section in stored:
        (pages / f"{section}.md").write_text(texts.sheet(section), encoding="utf-8")
    (pages / "figures-and-tables.md").write_text(texts.items(stored), encoding="utf-8")
    (pages / "claims.md").write_text(texts.all_claims(stored), encoding="utf-8")
    (pages / "paper.md").write_text(texts.paper(), encoding="utf-8")
    (pages / "index.md").write_text(texts.index(stored), encoding="utf-8")
    which = source_folder / "which-way.md"
    which.write_text(which.read_text("utf-8") + "\n" + texts.decision(), encoding="utf-8")
    return texts.incomplete


def copy_data(results: Results, pages: Path) -> None:
    """Put the files of all results beside the pages, where sheets refer to them."""
    for section in SECTIONS:
        folder = pages / "data" / section
        folder.mkdir(parents=True)
        for case in results.cases(section):
            for name in (f"{case}.json", f"{case}.npz"):
                if (path := results.folder / section / name).is_file():
                    shutil.copy(path, folder)


class _Sheets(Texts):
    """Texts as pages of the site.

    Attributes:
        incomplete: What is missing, a line for each.
    """

    def __init__(self, results: Results) -> None:
        super().__init__(results, [HERE, HERE.parent / "report"])
        self.incomplete: list[str] = []
        self._tables: dict[str, Markup] = {}
        words: dict[str, Callable[..., object]] = {
            "ref": _nothing,
            "cite": _nothing,
            "table": self._table,
            "claims_table": self.claims_table,
        }
        self.environment.globals |= words
        filters: dict[str, Callable[..., Markup]] = {
            "typeset": typeset,
            "relation": _relation,
            "computed": _computed,
        }
        self.environment.filters |= filters

    def sheet(self, section: str) -> str:
        """Return the page of a section."""
        name = mathematics.typeset(title(section), "{{sub}}`{}`")
        head = [f"# {section}: {name}", self._facts(section)]
        try:
            body = self.render(f"sections/{section}.html")
        except MissingResult as missing:
            self.incomplete.append(f"section {section}: {missing}")
            body = Markup('<p class="note">This sheet is incomplete: {}.</p>').format(missing)
        mine = [n for n, entry in self.figures.items() if entry["section"] == section]
        rest = Markup().join(self.figure(n) for n in mine if f'id="{n}"' not in body)
        return (
            "\n\n".join([*head, _as_markdown(_linked(body + rest, section)), self._data(section)])
            + "\n"
        )

    def figure(self, name: str) -> Markup:
        """Return a figure, whose file lies beside the pages."""
        if name not in self.figures:
            self.incomplete.append(f"figure {name} has not been drawn")
            return Markup()
        entry = dict(self.figures[name])
        folder = "../_static/figures"
        entry["caption"] = typeset(entry["caption"])
        entry["uri"] = f"{folder}/{name}.svg"
        entry["narrow_uri"] = f"{folder}/{name}.narrow.svg" if "narrow" in entry else None
        return self.render("figure.html", name=name, figure=entry, label=_label(name))

    def claims_table(self, rows: list[dict[str, Any]]) -> Markup:
        """Return the quantities of a sheet, with reference, error and tolerance.

        Pins are left out unless they differ.
        """
        shown = [row for row in rows if row["kind"] != "pin" or row["differs"]]
        return self.render("quantities.html", rows=shown) if shown else Markup()

    def all_claims(self, sections: list[str]) -> str:
        """Return the page of all claims and findings."""
        rows = [
            row | {"sections": [s for s in sections if names_section(row["source"], s)]}
            for row in self.claims
        ]
        page = self.render("all_claims.html", rows=rows, grades=judged.GRADES, sections=sections)
        text = (
            "Statements of the paper, each with one grade, and findings of this study, each with "
            "the number it is judged by. Tolerances count in favour of the statement; each entry "
            "says whether its tolerance was set before or after the first value was seen."
        )
        return f"# Claims and findings\n\n{text}\n\n{_raw(page)}\n"

    def items(self, sections: list[str]) -> str:
        """Return the index of the paper's figures, tables and equations."""
        parts = ["# The paper's figures and tables"]
        for kind, head in (("figure", "Figures"), ("table", "Tables"), ("equation", "Equations")):
            mine = [self._item(item, sections) for item in ITEMS if item.kind == kind]
            parts += [f"## {head}", _raw(self.render("items.html", rows=mine, kind=kind))]
        return "\n\n".join(parts) + "\n"

    def paper(self) -> str:
        """Return the page of what the paper is about and what of it holds."""
        parts = ["# The paper, and what of it holds"]
        for name in ("introduction", "conclusions"):
            try:
                parts.append(_as_markdown(_linked(self.render(f"sections/{name}.html"))))
            except MissingResult as missing:
                self.incomplete.append(f"{name}: {missing}")
        return "\n\n".join(parts) + "\n"

    def index(self, sections: list[str]) -> str:
        """Return the page that lists all sheets."""
        parts = ["# Evidence", (HERE / "evidence.md").read_text("utf-8")]
        for group, members in GROUPS.items():
            rows = [self._summary(section) for section in members if section in sections]
            parts += [f"## {group}", _raw(self.render("sheets.html", rows=rows))]
        cases = [case for section in sections for case in self.results.section(section)]
        parts.append(f"## Computed with\n\n{_raw(self.render('origin.html', **provenance(cases)))}")
        tree = "\n".join(["paper", "claims", "figures-and-tables", *sections])
        parts.append(f"```{{toctree}}\n:hidden:\n\n{tree}\n```")
        return "\n\n".join(parts) + "\n"

    def decision(self) -> str:
        """Return the report's table of what to use when, as it is without the report."""
        try:
            self.render("paper/answer.html")
        except MissingResult as missing:
            self.incomplete.append(f"the decision table: {missing}")
        return _raw(self._tables.get("decision", Markup()).replace(" ()", ""))

    def _table(self, name: str, caption: str, caller: Callable[[], str]) -> Markup:
        del caption  # which speaks of the report's parts
        self._tables[name] = self.render("decision.html", name=name, rows=Markup(caller()))
        return Markup()

    def _facts(self, section: str) -> str:
        sheet = SHEETS.get(section, {})
        if strange := sheet.keys() - {*PARTS}:
            raise StudyError(f"sheets.toml: {section} has {', '.join(sorted(strange))}")
        path = source(SECTIONS[section])
        assert path is not None
        cases = len(self.results.cases(section))
        rows = [(part.capitalize(), typeset(sheet[part])) for part in PARTS if part in sheet]
        rows += [
            ("Computed in", Markup("<code>{}</code>").format(path.relative_to(ROOT).as_posix())),
            ("Command", Markup("<code>./run study {}</code>").format(section)),
            ("Data", Markup('<a href="#data">{} results</a>').format(cases)),
        ]
        return _raw(self.render("facts.html", rows=rows))

    def _data(self, section: str) -> str:
        page = self.render("data.html", section=section, cases=self.results.section(section))
        return f"## Data\n\n{_raw(page)}"

    def _summary(self, section: str) -> dict[str, Any]:
        verdicts: dict[str, list[str]] = {"paper": [], "finding": [], "pin": []}
        for row in self.claims_of(section):
            kind = "paper" if row["kind"] in judged.PAPER else row["kind"]
            verdicts[kind].append(row["verdict"])
        counts = {kind: (len(mine), mine.count("holds")) for kind, mine in verdicts.items()}
        drawn = [name for name, entry in self.figures.items() if entry["section"] == section]
        return {"id": section, "title": title(section), **counts, "figure": drawn[-1:]}

    def _item(self, item: Item, sections: list[str]) -> dict[str, Any]:
        name = next((n for n in self.figures if _shows(n, item)), None)
        return {
            "item": item,
            "section": TITLES.get(item.section) or title(item.section),
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


def _nothing(*names: str) -> Markup:
    """Stand for the report's references to its own parts and sources."""
    del names
    return Markup()


_PAPERS = re.compile(r"(fig|tab)0*(\d+)(?:_0*(\d+))?")


def _label(name: str) -> str:
    """Return "The paper's Figs 7 to 8." for fig07_08; nothing for figures of this study."""
    if not (match := _PAPERS.fullmatch(name)):
        return ""
    if match[1] == "tab":
        return f"To the paper's Table {match[2]}."
    if match[3]:
        return f"The paper's Figs {match[2]} to {match[3]}."
    return f"The paper's Fig. {match[2]}."


def _shows(name: str, item: Item) -> bool:
    """Tell whether a figure is an item of the paper, or one of several."""
    match = _PAPERS.fullmatch(name)
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
