"""Summarise the computations of a section: numbers of unknowns, mesh sizes, quadrature degrees."""

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
"""Quadrature degree that the library uses for non-polynomial integrands.

A test checks that it equals the library's value.
"""


class SectionComputation(NamedTuple):
    """Summary of the computations of a section.

    Attributes:
        n_results: Number of results.
        n_recorded: Number of results that are read from the records in version control.
        unknowns_range: Smallest and largest number of unknowns.
        mesh_sizes: Mesh sizes, such as "16 × 4" divisions, from coarse to fine.
        quadrature_degrees: Quadrature degrees that the modules of the section set.
    """

    n_results: int
    n_recorded: int
    unknowns_range: tuple[int, int]
    mesh_sizes: list[str]
    quadrature_degrees: list[int]


def describe_computation_of_section(results: Results, section: str) -> SectionComputation:
    """Summarise the computations of a section from its stored results and its source code.

    Args:
        results: Stored results.
        section: Name of the section.
    """
    cases = results.section(section)
    unknowns = [n for case in cases if (n := _count_unknowns(case))]
    sizes = {size for case in cases for size in _list_mesh_sizes_of_result(case)}
    sorted_sizes = sorted(sizes, key=np.prod)
    return SectionComputation(
        len(cases),
        sum(bool(case.record) for case in cases),
        (min(unknowns), max(unknowns)),
        [" × ".join(f"{n:.3g}" if n < 1000 else f"{n:.0f}" for n in size) for size in sorted_sizes],
        sorted(_find_quadrature_degrees_set_by_section(SECTIONS[section])),
    )


def count_computed_and_recorded_results(results: Results) -> tuple[int, int]:
    """Count the readable results of all sections.

    Returns:
        Number of computed results, and number of results read from the records in version control.
    """
    cases = [case for section in SECTIONS for case in results.readable_results(section)]
    n_recorded = sum(bool(case.record) for case in cases)
    return len(cases) - n_recorded, n_recorded


def _count_unknowns(case: StoredResult) -> int:
    return int(case.provenance.get("dofs") or case.parameters.get("dofs") or 0)


def _list_mesh_sizes_of_result(case: StoredResult) -> list[tuple[float, ...]]:
    """Return the mesh sizes of a result, from its parameters or from the curves of a mesh series.

    Returns:
        One tuple per mesh: (number,), or (divisions in x, divisions in y).
    """
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


def _find_quadrature_degrees_set_by_section(module: str) -> set[int]:
    """Return all quadrature degrees that modules of a section assign to the constant `DEGREE`.

    `DEGREE` is a number, or a mapping from spatial dimensions to numbers. The modules of a section
    are those in the folder of its page or, for a page outside such a folder, those with the same
    prefix.

    Args:
        module: Module of the section's page.
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
