"""What a section was computed with: unknowns, meshes and quadrature, from results and sources."""

import ast
from typing import Any, NamedTuple

import numpy as np

from study.run.cases import SECTIONS
from study.run.sources import collect_imported_sources
from study.run.store import Results, StoredResult

# Parameters, and curves of series, that say how fine a mesh is
MESHES = (
    "divisions",
    "squares",
    "under_half",
    "zone_elements",
    "elements",
    "edges",
    "cells",
    "mesh",
    "n",
    "sides",
)


RATIONAL_DEGREE = 8
"""The library's degree of quadrature for integrands that are no polynomials; a test compares it."""


class Computed(NamedTuple):
    """What a section was computed with.

    Attributes:
        cases: How many results there are.
        recorded: How many of them are read from tracked records.
        unknowns: The fewest and the most of a mesh.
        meshes: Sizes that the parameters name, from coarse to fine.
        degrees: Of quadrature, where the section's own code sets them.
    """

    cases: int
    recorded: int
    unknowns: tuple[int, int]
    meshes: list[str]
    degrees: list[int]


def computed(results: Results, section: str) -> Computed:
    """Return what a section was computed with, as its results and its code say."""
    cases = results.section(section)
    unknowns = [n for case in cases if (n := _unknowns(case))]
    sizes = {size for case in cases for size in _sizes(case)}
    meshes = sorted(sizes, key=np.prod)
    return Computed(
        len(cases),
        sum(bool(case.record) for case in cases),
        (min(unknowns), max(unknowns)),
        [" × ".join(f"{n:.3g}" if n < 1000 else f"{n:.0f}" for n in size) for size in meshes],
        sorted(_degrees(SECTIONS[section])),
    )


def computed_and_recorded(results: Results) -> tuple[int, int]:
    """Return how many results were computed, and how many were read from tracked records."""
    cases = [case for section in SECTIONS for case in results.readable_results(section)]
    recorded = sum(bool(case.record) for case in cases)
    return len(cases) - recorded, recorded


def _unknowns(case: StoredResult) -> int:
    return int(case.provenance.get("dofs") or case.parameters.get("dofs") or 0)


def _sizes(case: StoredResult) -> list[tuple[float, ...]]:
    """Return the sizes of a case's meshes: (n,) or, for divisions, (n, m)."""
    sizes: list[Any] = []
    for name in MESHES:
        value = case.parameters.get(name)
        if name == "divisions" and value:
            sizes.append(value)
        elif name == "sides" and value:
            sizes += [1 / side for side in value]
        elif value is not None and not isinstance(value, str):  # the name of a kind of meshes
            sizes += value if isinstance(value, list) else [value]
    if not sizes:  # a series of meshes
        curves = (case.curves[name] for name in MESHES if name in case.curves)
        sizes += [size for curve in curves if curve.ndim == 1 for size in curve.tolist()]
    return [tuple(size) if isinstance(size, list) else (size,) for size in sizes]


def _degrees(module: str) -> set[int]:
    """Return what modules of a section assign to DEGREE: a number, or one for each dimension.

    Modules of a section are those in the folder of its page, or those that share its prefix.
    """
    folder, _, name = module.rpartition(".")
    own = f"{folder}." if name == "page" else f"{folder}.{name.partition('_')[0]}_"
    found: set[int] = set()
    for other, path in collect_imported_sources(module).items():
        if not other.startswith(own):
            continue
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "DEGREE":
                value = ast.literal_eval(node.value)
                found |= set(value.values()) if isinstance(value, dict) else {value}
    return found
