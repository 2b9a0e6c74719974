"""Find the study's pages, one per section, and read their constants without importing them.

A page is a module, or the module `page` of a folder, that assigns the name of its section to
`SECTION`. Texts and facts on a page are constants, and therefore the report can be written without
the solver. Cases, checks and figures require importing the page, which imports the solver.
"""

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from study.run.store import Results

STUDY = Path(__file__).parents[1]
SECTION_LINE = re.compile(r'^SECTION = "(.+)"$', re.MULTILINE)
_SECTION_LETTERS = ("I", "", "T", "C", "V", "Q", "W", "P", "K")
"""Letters of the sections, in the order of the report; the paper's sections have no letter."""


@dataclass(frozen=True)
class PageFigure:
    """Figure that is drawn by a function on the page of its section.

    Attributes:
        name: Name of the figure's files, without extension.
        draw: Function that draws the figure from stored results. The first line of its docstring
            is the figure's title.
        needs: Keys of the results that the figure needs.
        caption: Caption, or a function that returns it for given results.
        alt: Description for readers who cannot see the figure, or a function that returns it for
            given results.
    """

    name: str
    draw: "Callable[[Results], Figure]"
    needs: Sequence[str]
    caption: "str | Callable[[Results], str]"
    alt: "str | Callable[[Results], str]"


def find_pages(folders: Sequence[str] = ("paper", "benchmarks")) -> dict[str, str]:
    """Return the module of each section, in the order of the report.

    Args:
        folders: Subfolders of `study` to search.
    """
    modules = {}
    for folder in folders:
        for path in sorted((STUDY / folder).rglob("*.py")):
            if match := SECTION_LINE.search(path.read_text(encoding="utf-8")):
                parts = path.relative_to(STUDY.parent).with_suffix("").parts
                modules[match[1]] = ".".join(parts)
    return {section: modules[section] for section in sorted(modules, key=section_order)}


def section_order(section: str) -> tuple[int, float, str]:
    """Return the sorting key of a section; V9 comes before V10, and unknown letters come last."""
    letter = section.rstrip("0123456789.")
    group = _SECTION_LETTERS.index(letter) if letter in _SECTION_LETTERS else len(_SECTION_LETTERS)
    return group, float(section.removeprefix(letter) or 0), section


def read_constants(path: Path) -> Mapping[str, Any]:
    """Return the values of all constants to which a module assigns literals, by name."""
    return _read_constants(path.read_bytes())


@cache
def _read_constants(source: bytes) -> dict[str, Any]:
    constants = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            try:
                constants[node.targets[0].id] = ast.literal_eval(node.value)
            except ValueError:
                continue  # computed, not a literal
    return constants


def list_figures(path: Path) -> list[str]:
    """Return the names of the figures in the list `FIGURES` of a page."""
    return list(_list_figures(path.read_bytes()))


@cache
def _list_figures(source: bytes) -> tuple[str, ...]:
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "FIGURES":
            assert isinstance(node.value, ast.List)
            calls = [item for item in node.value.elts if isinstance(item, ast.Call)]
            return tuple(str(ast.literal_eval(call.args[0])) for call in calls)
    return ()
