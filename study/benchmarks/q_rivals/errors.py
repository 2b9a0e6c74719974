"""Errors of contact pressures and nodal forces of a method relative to Hertz' solution."""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import assemble_vector, test_space
from study.solutions.hertz_problem import Form, Problem, Solution
from study.solutions.indentation import INNER_PART

Array = npt.NDArray[Any]

SAMPLES_PER_SIDE = {1: 64, 2: 12}
"""Number of sample intervals per edge (normal axis 1) or per side of a face (normal axis 2)."""
CONTACT_PRESSURE_THRESHOLD = 1e-2
"""Pressure relative to Hertz' peak above which a point counts as in contact."""
ERROR_WITHOUT_SOLUTION = 10.0
"""Value stored as the error of a method that does not converge."""


def compute_pressure_and_force_errors(
    problem: Problem, solution: Solution
) -> tuple[dict[str, float], dict[str, Array]]:
    """Compute errors of the pressure and nodal forces of a solution, and curves along the surface.

    Lengths are relative to the half width of the contact, pressures to Hertz' peak pressure, and
    nodal forces to the integrals of the exact pressure times piecewise-linear shape functions.

    Args:
        problem: Problem that was solved; the mesh of the solution may differ.
        solution: Solution by one of the methods.

    Returns:
        Scalars and curves by name; there are no curves in three dimensions.
    """
    V = solution.u.function_space
    problem = replace(problem, mesh=V.mesh)
    peak, up = problem.exact.peak_pressure, problem.normal_axis
    r, pressure = sample_traction_over_distance(problem, solution.pressure)
    pressure = pressure / peak
    nodes = V.tabulate_dof_coordinates()
    force = problem.nodal_forces(solution.u, solution.test_space)[:, up] / peak
    exact_pressure = ufl.sqrt(ufl.max_value(0, 1 - problem.distance_from_middle**2))
    even_space = test_space(V) if V.element.basix_element.degree == 2 else V
    v = ufl.TestFunction(even_space)
    exact_forces = assemble_vector(v[up] * exact_pressure * problem.contact_measure)
    even_force = exact_forces.array.reshape(len(nodes), -1)[:, up]
    may_touch = problem.may_touch(nodes.T)
    is_inner = may_touch & (np.linalg.norm(nodes[:, :up], axis=1) < INNER_PART)
    force_ratio = force[is_inner] / even_force[is_inner]
    scalars = compute_pressure_errors(r, pressure) | {
        "force_least": force_ratio.min(),
        "force_largest": force_ratio.max(),
        "unknowns": solution.n_unknowns,
        "factorisations": solution.n_factorisations,
    }
    curves = {}
    if up == 2:
        del scalars["variation"]  # only defined along a line
    else:
        touching = np.flatnonzero(may_touch)
        touching = touching[np.argsort(nodes[touching, 0])]
        displacement = solution.u.x.array.reshape(len(nodes), -1)[touching].ravel()
        curves = {"x": r, "pressure": pressure, "node_x": nodes[touching, 0]}
        curves |= {"node_force": force[touching], "node_displacement": displacement}
    return {name: float(value) for name, value in scalars.items()}, curves


def compute_pressure_errors(distance: Array, pressure: Array) -> dict[str, float]:
    """Compute errors of a sampled pressure relative to Hertz' pressure.

    Args:
        distance: Increasing distances (n,) of sample points of equal area from the middle, relative
            to the half width of the contact.
        pressure: Pressures (n,) at these points, relative to Hertz' peak pressure.

    Returns:
        Relative L2 errors (of all points, of the inner part and of the rest), the radius of the
        contact, and the total variation in excess of that of a decreasing pressure.
    """
    exact, is_inner = np.sqrt(np.maximum(0, 1 - distance**2)), distance < INNER_PART
    error, total_variation = pressure - exact, np.abs(np.diff(pressure)).sum()
    return {
        "pressure_l2": _euclidean_norm(error) / _euclidean_norm(exact),
        "pressure_l2_inner": _euclidean_norm(error[is_inner]) / _euclidean_norm(exact[is_inner]),
        "pressure_l2_edge": _euclidean_norm(error[~is_inner]) / _euclidean_norm(exact[~is_inner]),
        "radius": float(distance[pressure > CONTACT_PRESSURE_THRESHOLD].max()),
        "variation": float(total_variation - (pressure[0] - pressure[-1])),
    }


def _euclidean_norm(values: Array) -> float:
    return float(np.linalg.norm(values))


def sample_traction_over_distance(problem: Problem, traction: Form) -> tuple[Array, Array]:
    """Evaluate a traction at points of equal area on the part of the surface that may touch.

    Returns:
        Increasing distances (n,) of the points from the middle, and the tractions (n,) there.
    """
    mesh, n = problem.mesh, SAMPLES_PER_SIDE[problem.normal_axis]
    points = ((np.arange(n) + 0.5) / n)[:, None]
    if problem.normal_axis == 2:  # use the centroids of n² equal triangles
        thirds = np.concatenate([np.arange(n) + 1 / 3, np.arange(n - 1) + 2 / 3]) / n
        s, t = np.meshgrid(thirds, thirds)
        is_first = np.arange(len(thirds)) < n
        is_centroid = is_first[:, None] == is_first
        points = np.column_stack([s[is_centroid], t[is_centroid]])
        points = points[points.sum(axis=1) < 1]
    entities = _find_cells_and_local_facets(mesh, problem.contact_facets)
    if not hasattr(fem.Expression, "argument_space"):  # DOLFINx 0.9 takes a flat array
        entities = entities.ravel()
    distance, value = (
        fem.Expression(form, points).eval(mesh, entities).ravel()
        for form in (problem.distance_from_middle, traction)
    )
    order = np.argsort(distance, kind="stable")
    return distance[order], value[order]


def _find_cells_and_local_facets(
    mesh: Mesh, facets: npt.NDArray[np.int32]
) -> npt.NDArray[np.int32]:
    """Return pairs (n, 2) of the cell of each exterior facet and the facet's local number in it."""
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
