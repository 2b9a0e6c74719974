"""Draw the figures of report and website from stored results, and detect outdated figures."""

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
from figures.narrow import rearrange_figure_for_telephone
from figures.style import MAX_VECTOR_ITEMS, study_style
from study.run import files
from study.run.cases import SECTIONS, find_page_source
from study.run.pages import list_names_of_page_figures
from study.run.sources import collect_imported_sources, digest_code_used_by_definition
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
    """Functions and texts that define a figure; they come from a script or the page of a section.

    Attributes:
        section: Section to which the figure belongs.
        title: Title in one line.
        needs: Keys of the results that the figure requires.
        draw: Function that draws the figure.
        caption: Function that returns the caption.
        alt: Function that returns a description for readers who cannot see the figure.
    """

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
        error: Error message if drawing failed; otherwise empty.
    """

    entry: FigureEntry | None
    missing: list[str]
    error: str


def list_names_of_all_figures() -> list[str]:
    """Return the names of the figures of all scripts and all pages, in natural order."""
    names = {module.name for module in pkgutil.iter_modules(figures.__path__)}
    return sorted(
        (names - FRAME_MODULES) | section_of_each_page_figure().keys(), key=natural_sort_key
    )


def section_of_each_page_figure() -> dict[str, str]:
    """Return the section of each figure that is defined on a page, by name of figure."""
    return {
        name: section
        for section in SECTIONS
        for name in list_names_of_page_figures(find_page_source(section))
    }


def load_figure_script(name: str) -> FigureScript:
    """Import the script or the page that defines a figure, and return the functions and texts.

    Args:
        name: Name of the figure, such as "fig07_08".
    """
    section = section_of_each_page_figure().get(name)
    if section is None:
        script = import_module(f"figures.{name}")
        title = _first_line(script.__doc__) or name
        needs = list(script.NEEDS)
        return FigureScript(script.SECTION, title, needs, script.draw, script.caption, script.alt)
    page = import_module(SECTIONS[section])
    (figure,) = (page_figure for page_figure in page.FIGURES if page_figure.name == name)
    title = _first_line(figure.draw.__doc__) or name
    texts = [_wrap_text_in_function(figure.caption), _wrap_text_in_function(figure.alt)]
    return FigureScript(section, title, list(figure.needs), figure.draw, *texts)


def _wrap_text_in_function(text: str | Callable[[Results], str]) -> Callable[[Results], str]:
    return (lambda _: text) if isinstance(text, str) else text


def _first_line(text: str | None) -> str:
    return (text or "").strip().partition("\n")[0].rstrip(".")


def figure_title(name: str) -> str:
    """Return the one-line title of a figure; the script or page of the figure is imported."""
    return load_figure_script(name).title


def list_needed_results() -> dict[str, list[str]]:
    """Return the keys of the results that each figure requires, by name of figure."""
    return {name: load_figure_script(name).needs for name in list_names_of_all_figures()}


def draw_figure(name: str, folder: Path) -> DrawingOutcome:
    """Draw a figure into `<folder>/figures`, and store the digest by which it is up to date.

    Args:
        name: Name of the figure.
        folder: Folder of the results.
    """
    return _draw_and_report_missing_results(name, _DigestedResults(folder))


def export_figure_as_png_and_pdf(name: str, results: Results, path: Path) -> list[Path]:
    """Draw a figure as PNG and PDF.

    Args:
        name: Name of the figure.
        results: Results from which the figure is drawn.
        path: Path of both files without extension.

    Returns:
        Paths of both files.

    Raises:
        ForeignFileOrFolder: If an existing file at one of the paths is not an exported figure.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    paths = export_paths(path)
    is_replaceable = None if path.parent == results.folder / "figures" else _is_exported_figure
    with study_style():
        figure = load_figure_script(name).draw(results)
        _freeze_layout(figure)
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
    """Return the paths of the PNG and PDF files of an exported figure; `path` has no extension."""
    return [path.with_name(f"{path.name}.{kind}") for kind in EXPORT_METADATA]


def check_that_export_overwrites_only_exports(path: Path) -> None:
    """Check that exporting a figure overwrites no file other than an exported figure.

    Args:
        path: Path of both files without extension.

    Raises:
        ForeignFileOrFolder: If an existing file at one of the paths is not an exported figure.
    """
    for file in export_paths(path):
        files.check_file_replaceable(file, _is_exported_figure)


def _is_exported_figure(file: Path) -> bool:
    return EXPORT_MARK.encode() in file.read_bytes()


def update_figure(name: str, folder: Path) -> None:
    """Draw a figure from the results in a folder, unless the existing drawing is up to date."""
    if not find_index_entry_if_up_to_date(name, Results(folder)):
        draw_figure(name, folder)


def find_index_entry_if_up_to_date(name: str, results: Results) -> FigureEntry | None:
    """Return the index entry of a figure if its drawings are up to date.

    They are if neither sources nor results have changed since, and both files exist.

    Args:
        name: Name of the figure.
        results: Stored results.

    Returns:
        The entry; None if the figure has to be drawn.
    """
    try:
        note = json.loads(_path_of_figure_digest_file(results.folder, name).read_bytes())
        entry, digest = note["entry"], note["digest"]
        pictures = [picture_path(results.folder, name, kind) for kind in PICTURE_KINDS]
        file_digests = {key: _digest_result_file(results.folder, key) for key in note["keys"]}
        case_names = {section: results.cases(section) for section in note["sections"]}
        is_current = digest == _digest_sources_and_results_of_figure(name, file_digests, case_names)
        return entry if is_current and all(path.is_file() for path in pictures) else None
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def picture_path(folder: Path, name: str, kind: str) -> Path:
    """Return the path of a drawing.

    Args:
        folder: Folder of the results.
        name: Name of the figure.
        kind: Extension, one of `PICTURE_KINDS`.
    """
    return folder / "figures" / f"{name}.{kind}"


def natural_sort_key(name: str) -> list[tuple[int, str]]:
    """Return the sorting key of a name in natural order, such that fig2 comes before fig10."""
    parts = re.findall(r"\d+|\D+", name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


class _DigestedResults(TrackedResults):
    """Stored results that digest each file just before it is read for the first time.

    Other processes may store new results while a figure is drawn. If digests were computed
    afterwards, a figure of old results could be taken for one of the new results.

    Attributes:
        digests: Digests of the files that have been read, by key of the result.
        case_names: Names of all cases, for the sections whose cases have been listed.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(Results(folder))
        self.digests: dict[str, str] = {}
        self.case_names: dict[str, list[str]] = {}

    def __contains__(self, key: str) -> bool:
        self._digest_file_before_first_reading(key)
        return super().__contains__(key)

    def __getitem__(self, key: str) -> StoredResult:
        self._digest_file_before_first_reading(key)
        return super().__getitem__(key)

    def cases(self, section: str) -> list[str]:
        if section not in self.case_names:
            self.case_names[section] = super().cases(section)
        return self.case_names[section]

    def _digest_file_before_first_reading(self, key: str) -> None:
        if key not in self.digests:
            self.digests[key] = _digest_result_file(self.folder, key)


def _draw_and_report_missing_results(name: str, results: _DigestedResults) -> DrawingOutcome:
    try:
        script = load_figure_script(name)
        missing = [key for key in script.needs if not _is_readable(key, results)]
        if missing:
            return DrawingOutcome(None, missing, "")
        size, narrow = _write_wide_and_narrow_svg(script, name, results)
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
        digest = _digest_sources_and_results_of_figure(name, results.digests, results.case_names)
        keys, sections = sorted(results.digests), sorted(results.case_names)
        note = {"entry": entry, "digest": digest, "keys": keys, "sections": sections}
        write_json(_path_of_figure_digest_file(results.folder, name), note)
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


def _write_wide_and_narrow_svg(
    script: FigureScript, name: str, results: Results
) -> tuple[tuple[int, int], list[int]]:
    """Draw a figure twice, for wide and for narrow screens, and write both as SVG.

    Returns:
        Width and height of the wide and of the narrow drawing in CSS pixels.
    """
    with study_style():
        figure = script.draw(results)
        try:
            size = _size_in_css_pixels(figure)
            _freeze_layout(figure)
            write_atomically(picture_path(results.folder, name, "svg"), _render_small_svg(figure))
            narrow = rearrange_figure_for_telephone(script.draw(results))
            _freeze_layout(narrow)
            write_atomically(
                picture_path(results.folder, name, "narrow.svg"), _render_small_svg(narrow)
            )
            return size, list(_size_in_css_pixels(narrow))
        finally:
            plt.close("all")


def _size_in_css_pixels(figure: Figure) -> tuple[int, int]:
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return width, height


def _freeze_layout(figure: Figure) -> None:
    """Compute and freeze the layout of a figure, in two passes, because one truncates titles."""
    engine = figure.get_layout_engine()
    assert engine is not None, "the style has one"
    for _ in range(2):
        engine.execute(figure)
    figure.set_layout_engine("none")


def _render_small_svg(figure: Figure) -> bytes:
    for line in figure.findobj(Line2D):
        if line.get_linestyle() == "None" and np.size(line.get_xdata()) > MAX_VECTOR_ITEMS:
            line.set_rasterized(True)
    stream = io.StringIO()
    figure.savefig(stream, format="svg", dpi=RASTER_DPI, metadata={"Date": None})
    return _shrink_svg(stream.getvalue()).encode()


def _shrink_svg(svg: str) -> str:
    """Reduce the size of an SVG drawing without changing its appearance.

    Metadata are removed, coordinates are cut to a hundredth of a point, and images get fewer
    colours. Pages with dozens of drawings thus load faster.
    """
    removable_parts = r"<\?xml.*?\?>|<metadata>.*?</metadata>|<!--.*?-->|<!DOCTYPE.*?>"
    svg = re.sub(removable_parts, "", svg, flags=re.DOTALL)
    svg = re.sub(r' transform="rotate\(-0 [^"]*\)"', "", svg)
    svg = re.sub(r"\bfont: ([^;\"]+)", _expand_font_shorthand, svg)
    svg = re.sub(r'="(?!data:)[^"]*"', lambda match: re.sub(r"(\.\d\d)\d+", r"\1", match[0]), svg)
    svg = re.sub(r"(\.\d*?)0+(?=[ \"])", lambda m: m[1].rstrip("."), svg)
    svg = re.sub(r"data:image/png;base64,([^\"]+)", _reduce_image_colours, svg)
    return _remove_redundant_svg_parts(svg)


def _remove_redundant_svg_parts(svg: str) -> str:
    """Remove unreferenced ids, redundant groups and repeated styles from an SVG drawing."""
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
    """Replace the CSS property `font`, which WeasyPrint ignores, by separate properties.

    Args:
        font: Match of the property, whose group 1 is the value.
    """
    keywords, size, families = re.fullmatch(r"(.*?)([\d.]+px) (.*)", font[1]).groups()  # type: ignore[union-attr]
    words = keywords.split()
    styles = [word for word in words if word in ("italic", "oblique")]
    weights = [word for word in words if word == "bold" or word.isdigit()]
    families = ", ".join(dict.fromkeys([*families.split(", "), "sans-serif"]))
    properties = [("font-size", [size]), ("font-family", [families])]
    properties += [("font-style", styles), ("font-weight", weights)]
    return "; ".join(f"{name}: {value[0]}" for name, value in properties if value)


def _reduce_image_colours(image: re.Match[str]) -> str:
    """Convert a PNG image within an SVG drawing to a palette of `N_IMAGE_COLOURS` colours.

    Args:
        image: Match of the data URI, whose group 1 is the image in base64.
    """
    image_file = Image.open(io.BytesIO(base64.b64decode(image[1])))
    stream = io.BytesIO()
    image_file.quantize(N_IMAGE_COLOURS, Image.Quantize.FASTOCTREE).save(
        stream, format="png", optimize=True
    )
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}"


def _digest_sources_and_results_of_figure(
    name: str, file_digests: dict[str, str], case_names: dict[str, list[str]]
) -> str:
    """Return the digest of everything on which a figure depends: sources, Matplotlib and results.

    Args:
        name: Name of the figure.
        file_digests: Digests of the files of results that the figure reads, by key.
        case_names: Names of all cases, for the sections whose cases the figure lists.
    """
    digest = hashlib.sha256(_digest_sources_shared_by_figures())
    if (section := section_of_each_page_figure().get(name)) is not None:
        digest.update(
            json.dumps(digest_code_used_by_definition(SECTIONS[section], "FIGURES")).encode()
        )
    else:
        for path in (Path(folder, f"{name}.py") for folder in figures.__path__):
            digest.update(path.name.encode())
            digest.update(path.read_bytes() if path.is_file() else b"missing")
    digest.update(json.dumps([sorted(file_digests.items()), sorted(case_names.items())]).encode())
    return digest.hexdigest()


def _digest_result_file(folder: Path, key: str) -> str:
    try:
        return hashlib.sha256((folder / f"{key}.json").read_bytes()).hexdigest()
    except OSError:
        return "missing"


@cache
def _digest_sources_shared_by_figures() -> bytes:
    """Return the digest of the source files shared by all figures, and of Matplotlib's version."""
    folder = Path(__file__).parent
    paths = {folder / f"{name}.py" for name in FRAME_MODULES} | set(_list_study_sources(folder))
    digest = hashlib.sha256(matplotlib.__version__.encode())
    for path in sorted(paths):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.digest()


def _list_study_sources(folder: Path) -> Iterator[Path]:
    """Yield the source files of the study that figures import, directly or indirectly.

    Args:
        folder: Folder of the scripts of figures.
    """
    for script in folder.glob("*.py"):
        for module in re.findall(r"^from (study\.\S+) import", script.read_text(), re.M):
            yield from collect_imported_sources(module).values()
    for path in folder.parent.glob("study/judge/measures/*.py"):
        yield from collect_imported_sources(f"study.judge.measures.{path.stem}").values()


def _path_of_figure_digest_file(folder: Path, name: str) -> Path:
    return folder / "figures" / f"{name}.json"
