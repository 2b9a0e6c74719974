"""What a user would pick instead: methods of contact on one problem, each at its best.

Each method is a file of this folder, on the problem that `study.rivals.problem` states. Of those
with a parameter the whole sweep is computed, and the one with the smallest error counts, on each
mesh anew: that takes an exact solution to choose by, which no user has.
"""

from dataclasses import dataclass, replace
from importlib import import_module
from time import process_time
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import assemble_vector, test_space
from study.model.units import dimensionless, units_of
from study.rivals.problem import Answer, Form, NoSolution, Problem, line, sphere
from study.run.cases import Case, mark_costly
from study.run.sources import closure
from study.run.store import Result
from study.solutions.calculix.calculix import peer_of, tracked_digest
from study.solutions.calculix.hertz_line import PENALTIES
from study.solutions.indentation import INNER

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Method:
    """A method as tables and figures show it.

    Args:
        words: its name.
        choices: number of parameters that a user has to choose.
        taken: parameter where the sweep is not repeated: that which is best on most meshes.
    """

    words: str
    choices: int = 0
    taken: float | None = None


METHODS = {
    "pw-T6": Method("new element"),
    "snes-vi": Method("standard, SNES VI, own weights"),
    "snes-vi-t": Method("standard times T"),
    "snes-vi-projected": Method("standard, forces projected"),
    "snes-vi-stress": Method("standard, stresses", 1, 2.0),
    "nitsche-symmetric": Method("Nitsche, symmetric", 1, 10.0),
    "nitsche-skew": Method("Nitsche, skew-symmetric", 1, 3.0),
    "penalty": Method("penalty", 1, 10.0),
    "augmented-p1": Method("augmented Lagrangian P2/P1", 1, 10.0),
    "augmented-p2": Method("augmented Lagrangian P2/P2", 1, 10.0),
    "mortar-p1": Method("mortar P2/P1"),
    "mortar-p2": Method("mortar P2/P2"),
    "proximal-p1": Method("proximal Galerkin P2/P1", 2, 10.0),
    "proximal-p2": Method("proximal Galerkin P2/P2", 2, 10.0),
    "linear": Method("linear elements"),
}
EDGES, OFFSETS = (4, 8, 16), (0.375, 0.875)
PLACES = 8  # of the contact's edge within an element
IN_SPACE = (3, 5)  # edges over the contact's radius
PARTS = 64, 12  # into which an edge, and a face's side, are cut to integrate errors
OPEN = 1e-2  # pressure over its peak that counts as none
FAILED = 10.0  # stands for the error of a method that does not converge


def plane(method: str, edges: int, offset: float) -> Result:
    """A method on the half plane: errors of the pressure at the best parameter of its sweep.

    Curves have the errors over the whole sweep; `FAILED` where there is no solution.
    """
    return compared(method, line(edges, offset))


def scattered(method: str, edges: int, offset: float, offsets: int) -> Result:
    """A method, its parameter fixed, with the contact's edge at many places within an element.

    Args:
        method: name.
        edges: over the half width.
        offset: first place.
        offsets: number of places, evenly spaced.
    """
    places = offset + np.arange(offsets) / offsets
    errors = []
    for place in places:
        problem = line(edges, float(place))
        errors.append(measured(problem, _solved(method, problem, METHODS[method].taken))[0])
    names = ("pressure_l2", "pressure_l2_inner")
    curves = {name: np.array([one[name] for one in errors]) for name in names}
    scalars = {name: float(values.mean()) for name, values in curves.items()}
    scalars["pressure_l2_least"] = float(curves["pressure_l2"].min())
    scalars["pressure_l2_largest"] = float(curves["pressure_l2"].max())
    return Result(scalars, dimensionless(scalars), {"offset": places, **curves})


def space(method: str, edges: int, offset: float) -> Result:
    """A method on the half space, with CPU seconds of the best solution.

    Of the sweep only what is within a factor of ten of the best parameter in the plane.
    """
    taken = METHODS[method].taken or 1.0
    return compared(method, sphere(edges, offset), taken / 10, 10 * taken, timed=True)


def seconds(method: str, edges: int, offset: float) -> Result:
    """The same on the half plane."""
    return compared(method, line(edges, offset), timed=True)


def calculix(edges: int, offset: float, tracked: list[str]) -> Result:
    """CalculiX' own pressures, from tracked records with these digests."""
    found = []
    for penalty, digest in zip(PENALTIES, tracked, strict=True):
        peer = peer_of(f"hertz-line-{edges}-{offset}-{penalty}", digest)
        x = np.linspace(0, peer.numbers["x"][-1], 64 * len(peer.numbers["x"]))
        pressure = np.interp(x, peer.numbers["x"], peer.numbers["pressure"])
        found.append(_errors(x, pressure))
    best = min(range(len(found)), key=lambda k: found[k]["pressure_l2"])
    largest = max(one["pressure_l2"] for one in found)
    scalars = found[best] | {"parameter": PENALTIES[best], "pressure_l2_largest": largest}
    return Result(scalars, dimensionless(scalars))


def compared(
    method: str, problem: Problem, least: float = 0.0, most: float = np.inf, timed: bool = False
) -> Result:
    """A method on a problem, with CPU seconds if it is timed, from a second run.

    Args:
        method: name.
        problem: on a mesh.
        least: parameter from which on it is swept.
        most: and up to which.
        timed: whether it is.
    """
    sweep = [x for x in getattr(_module(method), "SWEEP", ()) if not x or least <= x <= most]
    found = []
    for parameter in sweep or [None]:
        try:
            found.append(measured(problem, _solved(method, problem, parameter)))
        except NoSolution:
            names = ("pressure_l2", "pressure_l2_inner", "factorisations")
            found.append((dict.fromkeys(names, FAILED), {}))
    errors = [scalars["pressure_l2"] for scalars, _ in found]
    order = [(round(one["pressure_l2"], 6), one["factorisations"]) for one, _ in found]
    best = order.index(min(order))
    scalars, curves = found[best]
    if sweep:
        scalars |= {"parameter": sweep[best], "pressure_l2_largest": max(errors)}
        curves |= {"sweep": np.array(sweep), "sweep_l2": np.array(errors)}
        curves["sweep_l2_inner"] = np.array([one["pressure_l2_inner"] for one, _ in found])
    if timed:
        start = process_time()
        _solved(method, problem, sweep[best] if sweep else None)
        scalars["cpu_seconds"] = process_time() - start
    units = units_of(scalars, {"cpu_seconds": "s", "*": "1"})
    return Result(scalars, units, curves, dofs=int(scalars["unknowns"]))


def _solved(method: str, problem: Problem, parameter: float | None) -> Answer:
    given = () if parameter is None else (parameter,)
    answer: Answer = _module(method).solve(problem, *given)
    return answer


def _module(method: str) -> ModuleType:
    return import_module(f"study.rivals.{method.replace('-', '_').lower()}")


def measured(given: Problem, answer: Answer) -> tuple[dict[str, float], dict[str, Array]]:
    """Errors and curves of an answer; lengths over the half width, pressures over Hertz' peak."""
    problem, V = replace(given, mesh=answer.u.function_space.mesh), answer.u.function_space
    peak, up = problem.known.peak, problem.up
    r, sizes = sampled(problem, answer.pressure)
    pressure = sizes / peak
    nodes = V.tabulate_dof_coordinates()
    force = problem.forces(answer.u, answer.tested)[:, up] / peak
    known = ufl.sqrt(ufl.max_value(0, 1 - problem.distance**2))
    even = test_space(V) if V.element.basix_element.degree == 2 else V
    shares = assemble_vector(ufl.TestFunction(even)[up] * known * problem.surface).array.reshape(
        len(nodes), -1
    )
    within = problem.touching(nodes.T) & (np.linalg.norm(nodes[:, :up], axis=1) < INNER)
    ratio = force[within] / shares[within, up]
    scalars = _errors(r, pressure) | {
        "force_least": ratio.min(),
        "force_largest": ratio.max(),
        "unknowns": answer.unknowns,
        "factorisations": answer.factorisations,
    }
    curves = {}
    if up == 2:
        del scalars["variation"]  # along a line
    else:
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
    entities = _cells_and_local_facets(mesh, problem.facets)
    if not hasattr(fem.Expression, "argument_space"):  # DOLFINx 0.9 takes them in one row
        entities = entities.ravel()
    values = [
        fem.Expression(form, points).eval(mesh, entities).ravel()
        for form in (problem.distance, pressure)
    ]
    order = np.argsort(values[0], kind="stable")
    return values[0][order], values[1][order]


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


def _errors(r: Array, pressure: Array) -> dict[str, float]:
    """Errors of pressures at points that stand for equal areas, in the order of r."""
    exact, inner = np.sqrt(np.maximum(0, 1 - r**2)), r < INNER
    error, turns = pressure - exact, np.abs(np.diff(pressure)).sum()
    return {
        "pressure_l2": _norm(error) / _norm(exact),
        "pressure_l2_inner": _norm(error[inner]) / _norm(exact[inner]),
        "pressure_l2_edge": _norm(error[~inner]) / _norm(exact[~inner]),
        "radius": float(r[pressure > OPEN].max()),
        "variation": float(turns - (pressure[0] - pressure[-1])),
    }


def _norm(values: Array) -> float:
    """Of values that stand for equal areas."""
    return float(np.linalg.norm(values))


def _lines(method: str) -> int:
    """Lines of a method's file, and of those of this folder that it builds on."""
    files = closure(_module(method).__name__).items()
    own = [path for module, path in files if "rivals." in module and not module.endswith("problem")]
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in own)


CASES = [
    Case(
        "Q",
        f"{name}-{n}-{q}",
        plane,
        {"method": name, "edges": n, "offset": q},
        {"words": method.words, "choices": method.choices, "lines": _lines(name)},
    )
    for name, method in METHODS.items()
    for n in EDGES
    for q in OFFSETS
]
CASES += [
    Case(
        "Q",
        f"offsets-{name}",
        scattered,
        {"method": name, "edges": 8, "offset": 1 / (2 * PLACES), "offsets": PLACES},
        {"words": method.words},
    )
    for name, method in METHODS.items()
]
CASES += [
    Case(
        "Q",
        f"calculix-{n}-{q}",
        calculix,
        {
            "edges": n,
            "offset": q,
            "tracked": [tracked_digest(f"hertz-line-{n}-{q}-{penalty}") for penalty in PENALTIES],
        },
        {"method": "calculix", "words": "CalculiX, faces by a penalty", "choices": 1},
    )
    for n in EDGES
    for q in OFFSETS
]
CASES += mark_costly(
    [
        Case(
            "Q",
            f"{run.__name__}-{method}-{n}",
            run,
            {"method": method, "edges": n, "offset": OFFSETS[0]},
            {"words": METHODS[method].words},
        )
        for run, meshes, methods in (
            (seconds, EDGES[-1:], METHODS),
            (space, IN_SPACE, [m for m in METHODS if not m.endswith("p2")]),
        )
        for n in meshes
        for method in methods
    ]
)
