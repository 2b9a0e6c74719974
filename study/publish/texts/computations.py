"""Describe how sections were computed: unknowns, meshes and quadrature."""

import ast
from typing import Any, NamedTuple

import numpy as np

from study.run.cases import SECTIONS
from study.run.sources import collect_imported_sources
from study.run.store import Results, StoredResult

# Names of parameters, or of curves of mesh series, that specify the fineness of a mesh
MESH_SIZE_NAMES = (
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


NON_POLYNOMIAL_DEGREE = 8
"""Quadrature degree of the library for non-polynomial integrands (checked by a test)."""


class SectionComputation(NamedTuple):
    """Numbers of results and unknowns, mesh sizes and quadrature degrees of a section.

    Attributes:
        n_results: Number of results.
        n_recorded: Number of results that are read from tracked records.
        unknowns_range: Smallest and largest number of unknowns.
        mesh_sizes: Mesh sizes that the parameters specify, from coarse to fine.
        quadrature_degrees: Quadrature degrees that the section's own code sets.
    """

    n_results: int
    n_recorded: int
    unknowns_range: tuple[int, int]
    mesh_sizes: list[str]
    quadrature_degrees: list[int]


def describe_computation(results: Results, section: str) -> SectionComputation:
    """Return the description of a section's computation from its results and code."""
    cases = results.section(section)
    unknowns = [n for case in cases if (n := _count_unknowns(case))]
    sizes = {size for case in cases for size in _mesh_sizes(case)}
    sorted_sizes = sorted(sizes, key=np.prod)
    return SectionComputation(
        len(cases),
        sum(bool(case.record) for case in cases),
        (min(unknowns), max(unknowns)),
        [" × ".join(f"{n:.3g}" if n < 1000 else f"{n:.0f}" for n in size) for size in sorted_sizes],
        sorted(_quadrature_degrees(SECTIONS[section])),
    )


def count_computed_and_recorded(results: Results) -> tuple[int, int]:
    """Return the numbers of results that were computed and that were read from records."""
    cases = [case for section in SECTIONS for case in results.readable_results(section)]
    n_recorded = sum(bool(case.record) for case in cases)
    return len(cases) - n_recorded, n_recorded


def _count_unknowns(case: StoredResult) -> int:
    return int(case.provenance.get("dofs") or case.parameters.get("dofs") or 0)


def _mesh_sizes(case: StoredResult) -> list[tuple[float, ...]]:
    """Return the sizes of a case's meshes as tuples, with two entries for divisions in x and y."""
    sizes: list[Any] = []
    for name in MESH_SIZE_NAMES:
        value = case.parameters.get(name)
        if name == "divisions" and value:
            sizes.append(value)
        elif name == "sides" and value:
            sizes += [1 / side for side in value]
        elif value is not None and not isinstance(value, str):  # the name of a type of mesh
            sizes += value if isinstance(value, list) else [value]
    if not sizes:  # a series of meshes
        curves = (case.curves[name] for name in MESH_SIZE_NAMES if name in case.curves)
        sizes += [size for curve in curves if curve.ndim == 1 for size in curve.tolist()]
    return [tuple(size) if isinstance(size, list) else (size,) for size in sizes]


def _quadrature_degrees(module: str) -> set[int]:
    """Return all quadrature degrees that modules of a section assign to DEGREE.

    DEGREE is a number or a mapping from dimensions to numbers. The modules of a section are those
    in the folder of its page, or those with the same prefix.
    """
    folder, _, name = module.rpartition(".")
    section_prefix = f"{folder}." if name == "page" else f"{folder}.{name.partition('_')[0]}_"
    degrees: set[int] = set()
    for imported_module, path in collect_imported_sources(module).items():
        if not imported_module.startswith(section_prefix):
            continue
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "DEGREE":
                value = ast.literal_eval(node.value)
                degrees |= set(value.values()) if isinstance(value, dict) else {value}
    return degrees
