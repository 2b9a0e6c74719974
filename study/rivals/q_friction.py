"""Section Q: the methods without friction, and with it: shear against that of a fine mesh."""

from functools import cache
from importlib import import_module
from time import process_time
from typing import Any

import numpy as np
import numpy.typing as npt

from study.model.units import dimensionless
from study.rivals import q_compare
from study.rivals.friction import new
from study.rivals.problem import Form, NoSolution, Problem, line
from study.rivals.q_compare import EDGES, FAILED, OFFSETS, sampled
from study.run.cases import Case, mark_costly
from study.run.store import Result

Array = npt.NDArray[Any]

SECTION = "Q"
TITLE = "What a user would pick instead"

METHODS = {
    "new": "new element",
    "standard": "standard, own weights",
    "nitsche": "Nitsche, symmetric",
    "skew": "Nitsche, skew-symmetric",
    "augmented": "augmented Lagrangian P2/P1",
}
FINE = 32  # edges of the reference, by the new element; the standard one is .36 % off it there


def friction(name: str, edges: int, offset: float) -> Result:
    """A method with the best parameter of its sweep: that of the smallest error of the shear."""
    problem, method = line(edges, offset), import_module(f"study.rivals.friction.{name}")
    known = _reference(offset)
    found = []
    for parameter in getattr(method, "SWEEP", (None,)):
        given = () if parameter is None else (parameter,)
        try:
            start = process_time()
            *tractions, count = method.solve(problem, *given)
            seconds = process_time() - start
        except NoSolution:
            found.append({"shear_l2": FAILED})
            continue
        errors = {}
        for what, traction, exact in zip(("pressure", "shear"), tractions, known, strict=True):
            x, values = _curve(problem, traction)
            wanted = np.interp(x, *exact)
            error = np.linalg.norm(values - wanted) / np.linalg.norm(wanted)
            errors[f"{what}_l2"] = float(error)
        choice = {} if parameter is None else {"parameter": parameter}
        found.append(errors | choice | {"factorisations": count, "cpu_seconds": seconds})
    scalars = min(found, key=lambda one: one["shear_l2"])
    scalars["shear_l2_largest"] = max(one["shear_l2"] for one in found)
    dofs = problem.space().dofmap.index_map.size_local * 2
    return Result(scalars, dimensionless(scalars), dofs=dofs)


@cache
def _reference(offset: float) -> list[tuple[Array, Array]]:
    problem = line(FINE, offset)
    return [_curve(problem, traction) for traction in new.solve(problem)[:2]]


def _curve(problem: Problem, traction: Form) -> tuple[Array, Array]:
    x, values = sampled(problem, traction)
    return x, values / problem.known.peak


CASES = [*q_compare.CASES]
CASES += mark_costly(
    [
        Case(
            "Q",
            f"friction-{name}-{n}",
            friction,
            {"name": name, "edges": n, "offset": OFFSETS[0]},
            {"method": f"{name}, friction", "words": words},
        )
        for name, words in METHODS.items()
        for n in EDGES
    ]
)
