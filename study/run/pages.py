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
_SECTION_LETTERS = ("I", "", "T", "E", "C", "V", "Q", "W", "P", "K")
"""First letters of section names, in the order of the report; sections of the paper have none."""


@dataclass(frozen=True)
class PageFigure:
    """Definition of a figure on the page of a section.

    Attributes:
        name: Name of the figure's files, without extension.
        draw: Function that draws the figure from stored results. The first line of its docstring is
            the title of the figure.
        needs: Keys of the results that the figure requires.
        caption: Caption, or a function that returns it for given results.
        alt: Description for readers who cannot see the figure, or a function that returns it for
            given results.
    """

    name: str
    draw: "Callable[[Results], Figure]"
    needs: Sequence[str]
    caption: "str | Callable[[Results], str]"
    alt: "str | Callable[[Results], str]"


def find_module_of_each_section(folders: Sequence[str] = ("paper", "benchmarks")) -> dict[str, str]:
    """Find the pages of the study by the constant `SECTION` in their source code.

    Args:
        folders: Subfolders of `study` to search.

    Returns:
        Full module name of each page, by name of section, in the order of the report.
    """
    modules = {}
    for folder in folders:
        for path in sorted((STUDY / folder).rglob("*.py")):
            if match := SECTION_LINE.search(path.read_text(encoding="utf-8")):
                parts = path.relative_to(STUDY.parent).with_suffix("").parts
                modules[match[1]] = ".".join(parts)
    return {section: modules[section] for section in sorted(modules, key=section_sort_key)}


def section_sort_key(section: str) -> tuple[int, float, str]:
    """Return the sorting key of a section; V9 precedes V10, and unknown letters come last."""
    letter = section.rstrip("0123456789.")
    group = _SECTION_LETTERS.index(letter) if letter in _SECTION_LETTERS else len(_SECTION_LETTERS)
    return group, float(section.removeprefix(letter) or 0), section


def read_literal_constants(path: Path) -> Mapping[str, Any]:
    """Read the values of a module's constants, by name, without importing the module.

    Only assignments of literals at the top level are read, not computed values.
    """
    return _parse_literal_constants(path.read_bytes())


@cache
def _parse_literal_constants(source: bytes) -> dict[str, Any]:
    constants = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            try:
                constants[node.targets[0].id] = ast.literal_eval(node.value)
            except ValueError:
                continue  # computed, not a literal
    return constants


def list_names_of_page_figures(path: Path) -> list[str]:
    """Return the names of the figures in the constant `FIGURES` of a page, without importing it."""
    return list(_parse_names_of_page_figures(path.read_bytes()))


@cache
def _parse_names_of_page_figures(source: bytes) -> tuple[str, ...]:
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "FIGURES":
            assert isinstance(node.value, ast.List)
            calls = [item for item in node.value.elts if isinstance(item, ast.Call)]
            return tuple(str(ast.literal_eval(call.args[0])) for call in calls)
    return ()
