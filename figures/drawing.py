"""Draw figures from stored results, and determine which figures are up to date."""

import base64
import hashlib
import io
import json
import pkgutil
import re
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

import figures
from figures.narrow import narrow_figure
from figures.style import MAX_VECTOR_ITEMS, study_style
from study.run import files
from study.run.cases import SECTIONS, find_page_source
from study.run.pages import list_figures
from study.run.sources import collect_imported_sources, digest_reached_sources
from study.run.store import (
    CorruptResult,
    MissingResult,
    Results,
    StoredResult,
    StudyError,
    TrackedResults,
    write_atomically,
    write_json,
)

FRAME_MODULES = {"__main__", "beam", "column", "contact", "drawing", "narrow", "run_study", "style"}

RASTER_DPI = 200  # resolution of rasterised parts of drawings, in dots per inch
PICTURE_KINDS = ("svg", "narrow.svg")  # the narrow one is for telephones
N_IMAGE_COLOURS = 128  # colours of rasterised parts; lines and uniform faces need few

SVG_NAMESPACE, XLINK_NAMESPACE = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"

EXPORT_MARK = "figure of pw_elements"  # identifies exported files in their metadata
EXPORT_METADATA = {"png": {"Software": EXPORT_MARK}, "pdf": {"Creator": EXPORT_MARK}}

FigureEntry = dict[str, Any]


class FigureScript(NamedTuple):
    """Functions and texts of a figure, from a script in this folder or the page of a section."""

    section: str
    title: str
    needs: list[str]
    draw: Callable[[Results], Figure]
    caption: Callable[[Results], str]
    alt: Callable[[Results], str]


class DrawingOutcome(NamedTuple):
    """Outcome of drawing a figure.

    Attributes:
        entry: Entry of the figure in the index; None if it was not drawn.
        missing: Keys of required results that are missing or unreadable.
        error: Reason why the figure could not be drawn; otherwise empty.
    """

    entry: FigureEntry | None
    missing: list[str]
    error: str


def list_scripts() -> list[str]:
    """Return the names of all figures of scripts and pages in natural order."""
    names = {module.name for module in pkgutil.iter_modules(figures.__path__)}
    return sorted((names - FRAME_MODULES) | page_figure_sections().keys(), key=natural_sort_key)


def page_figure_sections() -> dict[str, str]:
    """Return a mapping from each figure that is defined on a section's page to that section."""
    return {
        name: section for section in SECTIONS for name in list_figures(find_page_source(section))
    }


def load_script(name: str) -> FigureScript:
    """Import the script or page that draws a figure."""
    section = page_figure_sections().get(name)
    if section is None:
        script = import_module(f"figures.{name}")
        title = _first_line(script.__doc__) or name
        needs = list(script.NEEDS)
        return FigureScript(script.SECTION, title, needs, script.draw, script.caption, script.alt)
    page = import_module(SECTIONS[section])
    (figure,) = (page_figure for page_figure in page.FIGURES if page_figure.name == name)
    title = _first_line(figure.draw.__doc__) or name
    texts = [_as_function(figure.caption), _as_function(figure.alt)]
    return FigureScript(section, title, list(figure.needs), figure.draw, *texts)


def _as_function(text: str | Callable[[Results], str]) -> Callable[[Results], str]:
    return (lambda _: text) if isinstance(text, str) else text


def _first_line(text: str | None) -> str:
    return (text or "").strip().partition("\n")[0].rstrip(".")


def figure_title(name: str) -> str:
    """Return the title of a figure, which is a single line."""
    return load_script(name).title


def list_needed_results() -> dict[str, list[str]]:
    """Return the keys of the results that each figure needs."""
    return {name: load_script(name).needs for name in list_scripts()}


def draw_figure(name: str, folder: Path) -> DrawingOutcome:
    """Draw a figure into `<folder>/figures`, and record the results from which it was drawn."""
    return _try_to_draw(name, _DigestedResults(folder))


def export_figure(name: str, results: Results, path: Path) -> list[Path]:
    """Draw a figure as PNG and PDF; return the paths of both files.

    Args:
        name: Name of the figure.
        results: Results from which the figure is drawn.
        path: Path of the files without extension.

    Raises:
        ForeignFileOrFolder: If a file at one of the paths is not an exported figure.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    paths = export_paths(path)
    is_replaceable = None if path.parent == results.folder / "figures" else _is_export
    with study_style():
        figure = load_script(name).draw(results)
        _lay_out(figure)
        try:
            for file in paths:
                stream = io.BytesIO()
                kind = file.suffix[1:]
                figure.savefig(stream, format=kind, metadata=EXPORT_METADATA[kind])
                files.replace_file_atomically(file, stream.getvalue(), is_replaceable)
        finally:
            plt.close("all")
    return paths


def export_paths(path: Path) -> list[Path]:
    """Return the paths of the files that an export writes."""
    return [path.with_name(f"{path.name}.{kind}") for kind in EXPORT_METADATA]


def check_export_paths(path: Path) -> None:
    """Check that an export would overwrite only exported figures.

    Raises:
        ForeignFileOrFolder: If a file at one of the paths is not an exported figure.
    """
    for file in export_paths(path):
        files.check_file_replaceable(file, _is_export)


def _is_export(file: Path) -> bool:
    return EXPORT_MARK.encode() in file.read_bytes()


def update_figure(name: str, folder: Path) -> None:
    """Draw a figure from a folder of results unless it is up to date."""
    if not find_current_entry(name, Results(folder)):
        draw_figure(name, folder)


def find_current_entry(name: str, results: Results) -> FigureEntry | None:
    """Return the index entry of a figure if it is up to date, and otherwise None."""
    try:
        note = json.loads(_note_path(results.folder, name).read_bytes())
        entry, digest = note["entry"], note["digest"]
        pictures = [picture_path(results.folder, name, kind) for kind in PICTURE_KINDS]
        file_digests = {key: _file_digest(results.folder, key) for key in note["keys"]}
        case_names = {section: results.cases(section) for section in note["sections"]}
        is_current = digest == _figure_digest(name, file_digests, case_names)
        return entry if is_current and all(path.is_file() for path in pictures) else None
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def picture_path(folder: Path, name: str, kind: str) -> Path:
    """Return the path of a drawing of the given kind."""
    return folder / "figures" / f"{name}.{kind}"


def natural_sort_key(name: str) -> list[tuple[int, str]]:
    """Return the sorting key of a name in natural order, such that fig2 comes before fig10."""
    parts = re.findall(r"\d+|\D+", name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


class _DigestedResults(TrackedResults):
    """Results that compute the digest of each file directly before reading it for the first time.

    Other processes may store results while a figure is drawn. Results that are stored after a file
    was read must not be mistaken for those shown in the figure.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(Results(folder))
        self.digests: dict[str, str] = {}
        self.case_names: dict[str, list[str]] = {}

    def __contains__(self, key: str) -> bool:
        self._digest_file(key)
        return super().__contains__(key)

    def __getitem__(self, key: str) -> StoredResult:
        self._digest_file(key)
        return super().__getitem__(key)

    def cases(self, section: str) -> list[str]:
        if section not in self.case_names:
            self.case_names[section] = super().cases(section)
        return self.case_names[section]

    def _digest_file(self, key: str) -> None:
        if key not in self.digests:
            self.digests[key] = _file_digest(self.folder, key)


def _try_to_draw(name: str, results: _DigestedResults) -> DrawingOutcome:
    try:
        script = load_script(name)
        missing = [key for key in script.needs if not _is_readable(key, results)]
        if missing:
            return DrawingOutcome(None, missing, "")
        size, narrow = _write_pictures(script, name, results)
        entry = {
            "name": name,
            "title": script.title,
            "section": script.section,
            "caption": script.caption(results),
            "alt": script.alt(results),
            "width": size[0],
            "height": size[1],
            "narrow": narrow,
        }
        digest = _figure_digest(name, results.digests, results.case_names)
        keys, sections = sorted(results.digests), sorted(results.case_names)
        note = {"entry": entry, "digest": digest, "keys": keys, "sections": sections}
        write_json(_note_path(results.folder, name), note)
    except StudyError as error:
        return DrawingOutcome(None, [], str(error))
    except Exception as error:  # a faulty script must not affect other figures
        return DrawingOutcome(None, [], f"{type(error).__name__}: {error}")
    return DrawingOutcome(entry, [], "")


def _is_readable(key: str, results: Results) -> bool:
    try:
        return bool(results[key])
    except (MissingResult, CorruptResult):
        return False


def _write_pictures(
    script: FigureScript, name: str, results: Results
) -> tuple[tuple[int, int], list[int]]:
    """Draw both pictures; return the sizes in CSS pixels of the wide and the narrow one."""
    with study_style():
        figure = script.draw(results)
        try:
            size = _size_in_pixels(figure)
            _lay_out(figure)
            write_atomically(picture_path(results.folder, name, "svg"), _render_svg(figure))
            narrow = narrow_figure(script.draw(results))
            _lay_out(narrow)
            write_atomically(picture_path(results.folder, name, "narrow.svg"), _render_svg(narrow))
            return size, list(_size_in_pixels(narrow))
        finally:
            plt.close("all")


def _size_in_pixels(figure: Figure) -> tuple[int, int]:
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return width, height


def _lay_out(figure: Figure) -> None:
    """Compute and freeze the layout in two passes, because one pass truncates some titles."""
    engine = figure.get_layout_engine()
    assert engine is not None, "the style has one"
    for _ in range(2):
        engine.execute(figure)
    figure.set_layout_engine("none")


def _render_svg(figure: Figure) -> bytes:
    for line in figure.findobj(Line2D):
        if line.get_linestyle() == "None" and np.size(line.get_xdata()) > MAX_VECTOR_ITEMS:
            line.set_rasterized(True)
    stream = io.StringIO()
    figure.savefig(stream, format="svg", dpi=RASTER_DPI, metadata={"Date": None})
    return _shrink_svg(stream.getvalue()).encode()


def _shrink_svg(svg: str) -> str:
    """Return a drawing of smaller size and the same appearance, which renders faster.

    Positions are rounded to a hundredth of a point. This matters because a page contains dozens of
    drawings.
    """
    removable_parts = r"<\?xml.*?\?>|<metadata>.*?</metadata>|<!--.*?-->|<!DOCTYPE.*?>"
    svg = re.sub(removable_parts, "", svg, flags=re.DOTALL)
    svg = re.sub(r' transform="rotate\(-0 [^"]*\)"', "", svg)
    svg = re.sub(r"\bfont: ([^;\"]+)", _expand_font_shorthand, svg)
    svg = re.sub(r'="(?!data:)[^"]*"', lambda match: re.sub(r"(\.\d\d)\d+", r"\1", match[0]), svg)
    svg = re.sub(r"(\.\d*?)0+(?=[ \"])", lambda m: m[1].rstrip("."), svg)
    svg = re.sub(r"data:image/png;base64,([^\"]+)", _reduce_image_colours, svg)
    return _strip_svg(svg)


def _strip_svg(svg: str) -> str:
    """Return a drawing without unreferenced names and redundant elements."""
    ElementTree.register_namespace("", SVG_NAMESPACE)
    ElementTree.register_namespace("xlink", XLINK_NAMESPACE)
    root = ElementTree.fromstring(svg)
    referenced_ids = dict.fromkeys(re.findall(r"(?:href=\"|url\()#([\w.-]+)", svg))
    styles = {
        element.get("id"): element.get("style")
        for element in root.iter()
        if element.get("id") in referenced_ids
    }
    for parent in list(root.iter()):
        if parent.get("id") not in referenced_ids:
            parent.attrib.pop("id", None)
        referenced_id = parent.get(f"{{{XLINK_NAMESPACE}}}href", "#").removeprefix("#")
        if parent.tag == f"{{{SVG_NAMESPACE}}}use" and parent.get("style") == styles.get(
            referenced_id
        ):
            parent.attrib.pop("style", None)
        if path := parent.get("d"):
            parent.set("d", re.sub(r"\s*\n\s*|\s*([MLQCzZ])\s*", r"\1", path).strip())
    for group in root.iter(f"{{{SVG_NAMESPACE}}}g"):
        child_styles = {child.get("style") for child in group}
        if (
            len(group) > 1
            and len(child_styles) == 1
            and (style_text := child_styles.pop())
            and not group.get("style")
        ):
            group.set("style", style_text)
            for child in group:
                child.attrib.pop("style")
    for parent in reversed(list(root.iter())):
        for index, child in reversed(list(enumerate(parent))):
            if child.tag == f"{{{SVG_NAMESPACE}}}g" and not child.attrib:
                parent[index : index + 1] = list(child)
    for element in root.iter():
        element.tail = None
        element.text = element.text if element.text and element.text.strip() else None
        if style_text := element.get("style"):
            element.set("style", style_text.replace("; ", ";").replace(": ", ":"))
    text = ElementTree.tostring(root, encoding="unicode")
    for number, element_id in enumerate(sorted(referenced_ids, key=len, reverse=True)):
        for prefix, suffix in (('id="', '"'), ('href="#', '"'), ("url(#", ")")):
            text = text.replace(f"{prefix}{element_id}{suffix}", f"{prefix}n{number}{suffix}")
    return text.replace(" />", "/>")


def _expand_font_shorthand(font: re.Match[str]) -> str:
    """Replace the CSS `font` shorthand, which WeasyPrint ignores, by separate properties."""
    keywords, size, families = re.fullmatch(r"(.*?)([\d.]+px) (.*)", font[1]).groups()  # type: ignore[union-attr]
    words = keywords.split()
    styles = [word for word in words if word in ("italic", "oblique")]
    weights = [word for word in words if word == "bold" or word.isdigit()]
    families = ", ".join(dict.fromkeys([*families.split(", "), "sans-serif"]))
    properties = [("font-size", [size]), ("font-family", [families])]
    properties += [("font-style", styles), ("font-weight", weights)]
    return "; ".join(f"{name}: {value[0]}" for name, value in properties if value)


def _reduce_image_colours(image: re.Match[str]) -> str:
    """Convert an image within a drawing to a palette with few colours."""
    image_file = Image.open(io.BytesIO(base64.b64decode(image[1])))
    stream = io.BytesIO()
    image_file.quantize(N_IMAGE_COLOURS, Image.Quantize.FASTOCTREE).save(
        stream, format="png", optimize=True
    )
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}"


def _figure_digest(
    name: str, file_digests: dict[str, str], case_names: dict[str, list[str]]
) -> str:
    """Return the digest of sources, Matplotlib and results on which a figure depends.

    Args:
        name: Name of the figure.
        file_digests: Digests of the files of results that the figure reads, by key.
        case_names: Names of all cases, for the sections whose cases the figure lists.
    """
    digest = hashlib.sha256(_shared_sources_digest())
    if (section := page_figure_sections().get(name)) is not None:
        digest.update(json.dumps(digest_reached_sources(SECTIONS[section], "FIGURES")).encode())
    else:
        for path in (Path(folder, f"{name}.py") for folder in figures.__path__):
            digest.update(path.name.encode())
            digest.update(path.read_bytes() if path.is_file() else b"missing")
    digest.update(json.dumps([sorted(file_digests.items()), sorted(case_names.items())]).encode())
    return digest.hexdigest()


def _file_digest(folder: Path, key: str) -> str:
    try:
        return hashlib.sha256((folder / f"{key}.json").read_bytes()).hexdigest()
    except OSError:
        return "missing"


@cache
def _shared_sources_digest() -> bytes:
    """Return the digest of the sources that all figures share."""
    folder = Path(__file__).parent
    paths = {folder / f"{name}.py" for name in FRAME_MODULES} | set(_list_study_sources(folder))
    digest = hashlib.sha256(matplotlib.__version__.encode())
    for path in sorted(paths):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.digest()


def _list_study_sources(folder: Path) -> Iterator[Path]:
    """Yield the source files of the study's modules that figures import."""
    for script in folder.glob("*.py"):
        for module in re.findall(r"^from (study\.\S+) import", script.read_text(), re.M):
            yield from collect_imported_sources(module).values()
    for path in folder.parent.glob("study/judge/measures/*.py"):
        yield from collect_imported_sources(f"study.judge.measures.{path.stem}").values()


def _note_path(folder: Path, name: str) -> Path:
    return folder / "figures" / f"{name}.json"
