"""What a user would pick instead: methods of contact on one problem, each at its best.

Each method is a file of this folder, on the problem that `study.rivals.problem` states. Of those
with a parameter the whole sweep is computed, and the one with the smallest error counts, on each
mesh anew: that takes an exact solution to choose by, which no user has.
"""

from dataclasses import replace
from importlib import import_module

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import IntegralType

from pw_elements import assemble_vector, test_space
from study.core.cases import Case
from study.core.store import Result
from study.rivals.problem import Answer, Form, NoSolution, Problem, line
from study.units import dimensionless
from study.verification.indentation import INNER

TITLE = "What a user would pick instead"

Array = npt.NDArray[np.float64]

METHODS = (
    "pw-T6",
    "snes-vi",
    "snes-vi-t",
    "snes-vi-projected",
    "snes-vi-stress",
    "nitsche-symmetric",
    "nitsche-skew",
    "penalty",
    "augmented-p1",
    "augmented-p2",
    "mortar-p1",
    "mortar-p2",
    "proximal-p1",
    "proximal-p2",
    "linear",
)
EDGES, OFFSETS = (4, 8, 16), (0.375, 0.625)
PARTS = 64, 12  # into which an edge, and a face's side, are cut to integrate errors
OPEN = 1e-2  # pressure over its peak that counts as none
FAILED = 10.0  # stands for the error of a method that does not converge


def plane(method: str, edges: int, offset: float) -> Result:
    """A method on the half plane: errors of the pressure at the best parameter of its sweep.

    Curves have the errors over the whole sweep; `FAILED` where there is no solution.
    """
    return compared(method, line(edges, offset))


def compared(method: str, problem: Problem) -> Result:
    """A method on a problem."""
    module = import_module(f"study.rivals.{method.replace('-', '_').lower()}")
    sweep = getattr(module, "SWEEP", ())
    found = []
    for given in [{"parameter": value} for value in sweep] or [{}]:
        try:
            found.append(measured(problem, module.solve(problem, **given)))
        except NoSolution:
            found.append(({"pressure_l2": FAILED, "pressure_l2_inner": FAILED}, {}))
    errors = [scalars["pressure_l2"] for scalars, _ in found]
    best = int(np.argmin(errors))
    scalars, curves = found[best]
    inner = [one["pressure_l2_inner"] for one, _ in found]
    if sweep:
        scalars |= {"parameter": sweep[best], "pressure_l2_largest": max(errors)}
        curves |= {"sweep": np.array(sweep), "sweep_l2": np.array(errors)}
        curves["sweep_l2_inner"] = np.array(inner)
    return Result(scalars, dimensionless(scalars), curves, dofs=int(scalars["unknowns"]))


def measured(given: Problem, answer: Answer) -> tuple[dict[str, float], dict[str, Array]]:
    """Errors and curves of an answer; lengths over the half width, pressures over Hertz' peak."""
    problem, V = replace(given, mesh=answer.u.function_space.mesh), answer.u.function_space
    peak, up = problem.known.peak, problem.up
    r, pressure = sampled(problem, answer.pressure)
    pressure, exact = pressure / peak, np.sqrt(np.maximum(0, 1 - r**2))
    error, inner = pressure - exact, r < INNER

    nodes = V.tabulate_dof_coordinates()
    force = problem.forces(answer.u, answer.tested)[:, up] / peak
    known = ufl.sqrt(ufl.max_value(0, 1 - problem.distance**2))
    even = test_space(V) if V.element.basix_element.degree == 2 else V
    shares = assemble_vector(ufl.TestFunction(even)[up] * known * problem.surface).array.reshape(
        len(nodes), -1
    )
    within = problem.touching(nodes.T) & (np.linalg.norm(nodes[:, :up], axis=1) < INNER)
    ratio = force[within] / shares[within, up]
    scalars = {
        "pressure_l2": _norm(error) / _norm(exact),
        "pressure_l2_inner": _norm(error[inner]) / _norm(exact[inner]),
        "pressure_l2_edge": _norm(error[~inner]) / _norm(exact[~inner]),
        "radius": r[pressure > OPEN].max(),
        "force_least": ratio.min(),
        "force_largest": ratio.max(),
        "unknowns": answer.unknowns,
        "factorisations": answer.factorisations,
    }
    curves = {}
    if up == 1:
        scalars["variation"] = np.abs(np.diff(pressure)).sum() - (pressure[0] - pressure[-1])
        on = np.flatnonzero(problem.touching(nodes.T))
        on = on[np.argsort(nodes[on, 0])]
        curves = {"x": r, "pressure": pressure, "node_x": nodes[on, 0], "node_force": force[on]}
        curves["node_displacement"] = answer.u.x.array.reshape(len(nodes), -1)[on].ravel()
    return {name: float(value) for name, value in scalars.items()}, curves


def sampled(problem: Problem, pressure: Form) -> tuple[Array, Array]:
    """Distances from the middle (n,), increasing, of points of equal areas; pressures there."""
    mesh, dim, parts = problem.mesh, problem.up, PARTS[problem.up - 1]
    middles = (np.arange(parts) + 0.5) / parts
    points = middles[:, None]
    if dim == 2:  # a point and its mirror image in each square: both halves of the triangle's
        thirds = np.concatenate([np.arange(parts) + 1 / 3, np.arange(parts - 1) + 2 / 3]) / parts
        s, t = np.meshgrid(thirds, thirds)
        lower = np.arange(len(thirds)) < parts
        points = np.column_stack([s[lower[:, None] == lower], t[lower[:, None] == lower]])
        points = points[points.sum(axis=1) < 1]
    mesh.topology.create_connectivity(dim, dim + 1)
    entities = fem.compute_integration_domains(
        IntegralType.exterior_facet, mesh.topology, problem.facets, dim
    )
    values = [
        fem.Expression(form, points).eval(mesh, np.asarray(entities).ravel()).ravel()
        for form in (problem.distance, pressure)
    ]
    order = np.argsort(values[0], kind="stable")
    return values[0][order], values[1][order]


def _norm(values: Array) -> float:
    """Of values that stand for equal areas."""
    return float(np.linalg.norm(values))


CASES = [
    Case("Q", f"{method}-{n}-{q}", plane, {"method": method, "edges": n, "offset": q})
    for method in METHODS
    for n in EDGES
    for q in OFFSETS
]
