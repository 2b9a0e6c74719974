"""Errors of the pressure and of nodal forces that a method gives, against Hertz' solution."""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import assemble_vector, test_space
from study.solutions.hertz_problem import Answer, Form, Problem
from study.solutions.indentation import INNER

Array = npt.NDArray[Any]

SAMPLES_PER_SIDE = {1: 64, 2: 12}
"""Parts into which an edge, or a side of a face, is cut to integrate errors, by its dimension."""
NO_PRESSURE_BELOW = 1e-2
"""Pressure, relative to Hertz' peak, that does not count as contact."""
ERROR_WITHOUT_SOLUTION = 10.0
"""Stands for the error of a method that does not converge."""


def measure_answer(problem: Problem, answer: Answer) -> tuple[dict[str, float], dict[str, Array]]:
    """Return errors and curves of an answer.

    Lengths are over the half width, pressures over Hertz' peak, nodal forces over the exact
    pressure's integrals with piecewise-linear functions.

    Args:
        problem: that was solved; the answer may be on a mesh of its own.
        answer: by one of the methods.
    """
    V = answer.u.function_space
    problem = replace(problem, mesh=V.mesh)
    peak, up = problem.exact.peak, problem.up
    r, pressure = sample_surface(problem, answer.pressure)
    pressure = pressure / peak
    nodes = V.tabulate_dof_coordinates()
    force = problem.forces(answer.u, answer.test_space)[:, up] / peak
    exact = ufl.sqrt(ufl.max_value(0, 1 - problem.distance**2))
    even = test_space(V) if V.element.basix_element.degree == 2 else V
    shares = assemble_vector(ufl.TestFunction(even)[up] * exact * problem.surface)
    share = shares.array.reshape(len(nodes), -1)[:, up]
    may_touch = problem.may_touch(nodes.T)
    is_inner = may_touch & (np.linalg.norm(nodes[:, :up], axis=1) < INNER)
    force_ratio = force[is_inner] / share[is_inner]
    scalars = pressure_errors(r, pressure) | {
        "force_least": force_ratio.min(),
        "force_largest": force_ratio.max(),
        "unknowns": answer.unknowns,
        "factorisations": answer.factorisations,
    }
    curves = {}
    if up == 2:
        del scalars["variation"]  # is defined along a line
    else:
        touching = np.flatnonzero(may_touch)
        touching = touching[np.argsort(nodes[touching, 0])]
        displacement = answer.u.x.array.reshape(len(nodes), -1)[touching].ravel()
        curves = {"x": r, "pressure": pressure, "node_x": nodes[touching, 0]}
        curves |= {"node_force": force[touching], "node_displacement": displacement}
    return {name: float(value) for name, value in scalars.items()}, curves


def pressure_errors(r: Array, pressure: Array) -> dict[str, float]:
    """Return errors of pressures over Hertz' peak at points of equal areas, ordered by r."""
    exact, is_inner = np.sqrt(np.maximum(0, 1 - r**2)), r < INNER
    error, total_variation = pressure - exact, np.abs(np.diff(pressure)).sum()
    return {
        "pressure_l2": _norm(error) / _norm(exact),
        "pressure_l2_inner": _norm(error[is_inner]) / _norm(exact[is_inner]),
        "pressure_l2_edge": _norm(error[~is_inner]) / _norm(exact[~is_inner]),
        "radius": float(r[pressure > NO_PRESSURE_BELOW].max()),
        "variation": float(total_variation - (pressure[0] - pressure[-1])),
    }


def _norm(values: Array) -> float:
    return float(np.linalg.norm(values))


def sample_surface(problem: Problem, pressure: Form) -> tuple[Array, Array]:
    """Evaluate a pressure at points of equal areas of the surface that may touch.

    Returns:
        distances (n,) of the points from the middle, increasing; pressures (n,) there.
    """
    mesh, n = problem.mesh, SAMPLES_PER_SIDE[problem.up]
    points = ((np.arange(n) + 0.5) / n)[:, None]
    if problem.up == 2:  # a point and its mirror image in each square: both halves of the triangle
        thirds = np.concatenate([np.arange(n) + 1 / 3, np.arange(n - 1) + 2 / 3]) / n
        s, t = np.meshgrid(thirds, thirds)
        is_first = np.arange(len(thirds)) < n
        is_of_one_half = is_first[:, None] == is_first
        points = np.column_stack([s[is_of_one_half], t[is_of_one_half]])
        points = points[points.sum(axis=1) < 1]
    entities = _cells_and_local_facets(mesh, problem.facets)
    if not hasattr(fem.Expression, "argument_space"):  # DOLFINx 0.9 takes them in one row
        entities = entities.ravel()
    distance, value = (
        fem.Expression(form, points).eval(mesh, entities).ravel()
        for form in (problem.distance, pressure)
    )
    order = np.argsort(distance, kind="stable")
    return distance[order], value[order]


def _cells_and_local_facets(mesh: Mesh, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Return the cell of each exterior facet and the facet's number there, (n, 2)."""
    topology, dim = mesh.topology, mesh.topology.dim
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    cell_of, facets_of = topology.connectivity(dim - 1, dim), topology.connectivity(dim, dim - 1)
    pairs = [
        (cell, int(np.flatnonzero(facets_of.links(cell) == facet)[0]))
        for facet in facets
        for cell in cell_of.links(facet)
    ]
    return np.array(pairs, dtype=np.int32)
