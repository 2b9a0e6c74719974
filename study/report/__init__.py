"""The report: a paper of some thirty pages, one self-contained HTML page and a PDF of it."""

import gc
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jinja2
from markupsafe import Markup

from study.core.cases import SECTIONS
from study.core.store import CorruptResult, MissingResult, Results, StudyError, write_whole
from study.judge import claims as judged
from study.report import numbers
from study.report.texts import HERE, Texts, counts, italics, provenance, with_readings
from study.vocabulary import ELEMENTS

if TYPE_CHECKING:
    import weasyprint

# The parts in their order: template in `paper/`, chapter or section of one, title
PARTS = (
    ("answer", "", ""),
    ("evidence", "chapter", "What was tested, and with which result"),
    ("element", "chapter", "The element"),
    ("reading", "chapter", "How to read contact forces"),
    ("examples", "chapter", "The paper's examples"),
    ("7.2", "section", "Elastic block on a rigid surface (the paper's section 7.2)"),
    ("7.3", "section", "Parabolic rigid punch (7.3)"),
    ("7.4", "section", "Rigid plate on an elastic body (7.4)"),
    ("7.5", "section", "Stepped column (7.5)"),
    ("7.6", "section", "Buckling of a beam (7.6)"),
    ("beyond", "chapter", "Beyond the paper"),
    ("bodies", "section", "Two deformable bodies"),
    ("space", "section", "Contact and friction in three dimensions"),
    ("friction", "section", "Friction: four benchmarks"),
    ("impact", "section", "Dynamics and impact"),
    ("fluxes", "section", "Fluxes"),
    ("residuals", "section", "Large strains"),
    ("rubber", "section", "Nearly incompressible bodies: the hybrid element"),
    ("orders", "chapter", "Accuracy, and where the new element is worse"),
    ("cost", "chapter", "What it costs"),
    ("codes", "chapter", "Other codes, and verification in one table"),
    ("alternatives", "chapter", "Alternatives"),
    ("unknown", "chapter", "What could not be known, and errata of the paper"),
    ("references", "chapter", "References and nomenclature"),
)
# Sections of the paper whose statements are listed with its examples; the others' come before
HOMES = ("3", "4", "5", "6", "7.1", "7.2", "7.3", "7.4", "7.5", "7.6")
REFERENCES: dict[str, dict[str, str]] = tomllib.loads((HERE / "references.toml").read_text())
BREAK = r"(?<=[\d>]) (?=(?:%|°|mm|MPa|kN|μm)(?![\w/]))"  # where no line may end
ROUND_OFF = 1e-9  # what a statement's number is away from a whole one without saying so


class Rendered(NamedTuple):
    """The page, and what it lacks for want of results or figures, a line for each."""

    html: str
    incomplete: list[str]


class Part(NamedTuple):
    """A part of the report: its anchor, whether chapter or section, number, title and text."""

    id: str
    kind: str
    number: str
    title: str
    body: Markup


def build(results: Results, out: Path) -> list[str]:
    """Write `<out>/report.html` and `<out>/report.pdf` from results, claims and figures.

    The PDF comes first: a page on disk says that the PDF of the same source is there, too, and
    is not laid out again.

    Returns:
        What the report lacks for want of results or figures.
    """
    html, incomplete = render(results)
    page, pdf = Path(out) / "report.html", Path(out) / "report.pdf"
    if pdf.is_file() and page.is_file() and page.read_bytes() == html.encode():
        return incomplete
    write_whole(pdf, laid_out(html).write_pdf(pdf_variant="pdf/ua-1"))
    write_whole(page, html.encode())
    return incomplete


def render(results: Results, templates: Path = HERE) -> Rendered:
    """Return the page.

    Args:
        results: What to report; its folder has the claims and the figures, too.
        templates: Folder of the templates, with `paper/<part>.html` for each part's text.
    """
    try:
        first = _Paper(results, templates, {}, strict=False)
        first_parts = first.parts()
        known = first.numbers | {f"part {part.id[5:]}": part.number for part in first_parts}
        paper = _Paper(results, templates, known, strict=not first.incomplete)
        parts = paper.parts()
        cases = [case for section in SECTIONS for case in results.section(section)]
        origin = provenance(cases)
        html = paper.render(
            "paper/base.html",
            parts=parts,
            version=_version(),
            commits=sorted({case["commit"][:10] for case in origin["cases"] if case.get("commit")}),
            versions=list(origin["versions"].values()),
            date=max(
                (case["time"][:10] for case in origin["cases"] if case.get("time")), default=""
            ),
        )
    except jinja2.UndefinedError as error:  # results or claims that another version wrote
        raise CorruptResult(f"{results.folder}: {error}; run ./run study --force") from error
    return Rendered(str(html), paper.incomplete)


class _Paper(Texts):
    """The parts' texts, with figures, tables and references numbered as they come.

    Args:
        results: What is reported.
        templates: Folder of the templates.
        known: Numbers of figures, tables and parts, for what is referred to before it comes.
        strict: Whether all that is referred to is known.

    Attributes:
        numbers: The same, as found.
        incomplete: What is missing, a line for each.
    """

    def __init__(
        self, results: Results, templates: Path, known: dict[str, int | str], strict: bool
    ) -> None:
        super().__init__(results, [templates])
        self.known = known
        self.strict = strict
        self.numbers: dict[str, int] = {}
        self.incomplete: list[str] = []
        words: dict[str, object] = {
            "table": self.table,
            "ref": self.ref,
            "cite": self.cite,
            "cited": self.cited,
            "statements": self.statements,
            "counts": counts(self.claims),
            "grades": judged.GRADES,
            "graded": self.graded,
        }
        self.environment.globals |= words
        self.environment.filters |= {"found": found, "wanted": wanted, "in_words": in_words}

    def parts(self) -> list[Part]:
        """Return the parts; one that lacks results says so in the place of its text."""
        made: list[Part] = []
        chapter = section = 0
        for name, kind, title in PARTS:
            body = self._body(name)
            if not body.strip():  # there are no results yet of which it could tell
                continue
            chapter, section = (chapter, section + 1) if kind == "section" else (chapter + 1, 0)
            number = f"{chapter - 1}.{section}" if kind == "section" else f"{chapter - 1}"
            made.append(Part(f"part-{name}", kind, number, title, body))
        return made

    def figure(self, name: str) -> Markup:
        """Return a figure with its number and caption; a remark if it has not been drawn."""
        number = self._next("figure", name)
        if name not in self.figures:
            self.incomplete.append(f"figure {name} has not been drawn")
        figure = self.figures.get(name)
        label = f"Fig. {number}" + _of_the_paper(name)
        return super().render("figure.html", name=name, figure=figure, label=label)

    def table(
        self, name: str, caption: str, caller: Callable[[], str], of: str = "", long: bool = False
    ) -> Markup:
        """Return a table with its number and caption; `caller` gives its rows.

        One `of` a table of the paper says so; a long one may be broken by a page's end.
        """
        paper = f" (the paper's Table {of})" if of else ""
        return self.render(
            "paper/table.html",
            name=name,
            label=f"Table {self._next('table', name)}{paper}",
            caption=italics(caption),
            rows=caller(),
            long=long,
        )

    def ref(self, name: str) -> Markup:
        """Return a link to a figure, a table or a part, by the number that it has."""
        for kind, word in (("figure", "Fig."), ("table", "Table"), ("part", "section")):
            if (number := self.known.get(f"{kind} {name}")) is not None:
                anchor = f"part-{name}" if kind == "part" else name
                return Markup('<a href="#{}">{}\N{NO-BREAK SPACE}{}</a>').format(
                    anchor, word, number
                )
        if self.strict:
            raise StudyError(f"the report refers to {name}, which is not there")
        return Markup("?")  # numbers are not known yet, or results are missing

    def cite(self, *names: str) -> Markup:
        """Return numbers of references, as links."""
        for name in names:
            if name not in REFERENCES:
                raise StudyError(f"the report cites {name}, which is no reference")
            if f"reference {name}" not in self.numbers:
                self._next("reference", name)
        links = [
            Markup('<a href="#ref-{}">{}</a>').format(name, self.numbers[f"reference {name}"])
            for name in names
        ]
        return Markup("[{}]").format(Markup(", ").join(links))

    def cited(self) -> list[dict[str, str]]:
        """Return key, text and address of what is cited, in the order of the numbers."""
        keys = [key.split()[1] for key in self.numbers if key.startswith("reference ")]
        return [{"key": key, "url": "", **REFERENCES[key]} for key in keys]

    def statements(self, *homes: str) -> Markup:
        """Return a table of the paper's statements in some sections; without any, of the others."""
        return self.render("paper/statements.html", rows=self._of_paper(homes))

    def graded(self, *homes: str) -> Markup:
        """Return how many statements of some sections have which grade, in words."""
        grades = [row["grade"] for row in self._of_paper(homes)]
        return Markup(", ").join(
            f"{grades.count(grade)} {grade}" for grade in judged.GRADES if grade in grades
        )

    def _of_paper(self, homes: tuple[str, ...]) -> list[dict[str, Any]]:
        rows = with_readings([row for row in self.claims if row["kind"] in judged.PAPER])
        if not homes:
            return [row for row in rows if home(row["source"]) not in HOMES]
        return [row for row in rows if home(row["source"]) in homes]

    def _next(self, kind: str, name: str) -> int:
        if f"{kind} {name}" in self.numbers:
            raise StudyError(f"the report places {kind} {name} twice")
        number = 1 + sum(key.startswith(f"{kind} ") for key in self.numbers)
        self.numbers[f"{kind} {name}"] = number
        return number

    def _body(self, name: str) -> Markup:
        before = dict(self.numbers)
        try:
            body = self.render(f"paper/{name}.html")
            return Markup(re.sub(BREAK, numbers.THIN, body))
        except MissingResult as missing:
            self.numbers = before  # its figures and tables are not shown
            self.incomplete.append(f"{name}: {missing}")
            return Markup('<p class="note">This part is incomplete: {}.</p>').format(missing)


def home(source: str) -> str:
    """Return the section that a statement stands in: the first that its source names.

    Those of the abstract, the introduction and the conclusions stand before all.
    """
    place = re.match(r"[Ss]ec(?:tion|\.) (\d(?:\.\d)?)", source)
    return place[1] if place else ""


def found(row: dict[str, Any]) -> Markup:
    """Write what was measured of a statement, with its unit."""
    x, unit = row["measured"], row["unit"]
    if x is None:
        return Markup(numbers.DASH)
    if row["value"] == 0 and abs(x) < ROUND_OFF:
        return Markup("round-off")
    return _quantity(x, unit)


def wanted(row: dict[str, Any]) -> Markup:
    """Write what a statement asks for: relation, value and tolerance."""
    if row["relation"] is None:
        return Markup(numbers.DASH)
    relation = {"<=": "≤", ">=": "≥"}.get(row["relation"], row["relation"])
    scale, unit = _unit(row["unit"])
    value = numbers.short(row["value"] / scale, 5)
    if row["tol"] > ROUND_OFF:
        value += Markup(" ± {}").format(numbers.short(row["tol"] / scale, 3))
    return Markup("{} {}{}").format(relation, value, unit)


def _quantity(x: float, unit: str) -> Markup:
    scale, unit = _unit(unit)
    x /= scale
    whole = abs(x - round(x)) < ROUND_OFF * max(1.0, abs(x))
    digits = 3 if scale == 1.0 else 5
    return (numbers.fixed(x, 0) if whole else numbers.num(x, digits)) + unit


def _unit(unit: str) -> tuple[float, str]:
    """Return what to divide by, and the unit with the space before it."""
    scale, unit = (1e6, "MPa") if unit == "Pa" else (1.0, unit)
    return scale, f"{numbers.THIN}{unit}" if unit else ""


def in_words(statement: str) -> Markup:
    """Write a statement with names of elements for those of result files, and its mathematics.

    Names of findings, which are listed elsewhere, are left out.
    """
    statement = re.sub(r" \((?:[A-Z]\d*|\d\.?\d?)-[\w-]+\)", "", statement)
    words = re.sub(
        r"\b((?:galerkin|pw|pwsym|composite)-[TQ]\d)((?:-J|-lumped)?)\b",
        lambda m: (
            ELEMENTS[m[1]].name + {"-J": ", form J", "-lumped": ", lumped mass"}.get(m[2], "")
        ),
        statement,
    )
    safe = str(Markup.escape(words)).replace("L^T", "L<sup>T</sup>").replace(" x ", " × ")
    return Markup(re.sub(r"\b(h|x|p0|mu)\b(?= ?[<&|)])", r"<i>\1</i>", safe))


def _of_the_paper(name: str) -> str:
    """Return " (the paper's Figs 7 and 8)" for fig07_08; nothing for figures of this study."""
    if not (match := re.fullmatch(r"(fig|tab)0*(\d+)(?:_0*(\d+))?", name)):
        return ""
    if match[1] == "tab":
        return f" (to the paper's Table {match[2]})"
    if match[3] is None:
        return f" (the paper's Fig. {match[2]})"
    joint = " and " if int(match[3]) == int(match[2]) + 1 else " to "
    return f" (the paper's Figs {match[2]}{joint}{match[3]})"


def _version() -> str:
    """Return the project's version, of which the report is a part."""
    source = (HERE.parents[1] / "pw_elements" / "__init__.py").read_text(encoding="utf-8")
    return re.findall(r'^__version__ = "(.*)"$', source, re.MULTILINE)[0]


def _faces() -> str:
    """Return the faces of STIX, which Matplotlib brings: narrower than DejaVu, with italics."""
    import matplotlib

    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    faces = (
        ("", "normal", "normal"),
        ("Italic", "normal", "italic"),
        ("Bol", "bold", "normal"),
        ("BolIta", "bold", "italic"),
    )
    return "".join(
        f"@font-face {{ font-family: STIX; font-weight: {weight}; font-style: {slope}; "
        f"src: url('{(folder / f'STIXGeneral{ending}.ttf').as_uri()}'); }}\n"
        for ending, weight, slope in faces
    )


def laid_out(html: str) -> "weasyprint.Document":
    """Return the pages of the PDF, set in STIX."""
    import weasyprint  # half a second, and its libraries are not needed to read the page's code

    printed = html.replace("</head>", f"<style>{_faces()}</style></head>", 1)
    gc.disable()  # among millions of boxes that all stay, a fifth of the time for nothing
    try:
        return weasyprint.HTML(string=printed).render(pdf_variant="pdf/ua-1")
    finally:
        gc.enable()
