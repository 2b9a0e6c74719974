"""Does an engineer's answer change where nodal forces or pressures enter a law? Five problems.

Every case has an answer with its reference, and some have further ones; `error` is the distance
from the reference over its size. Readings are those of `readings`; "none" where nothing is read.
References are exact (the submodel's stress), or of Hertz' exact pressure on a fine mesh (the
joint), or the mean of both elements on a fine mesh, so that none is favoured: the error of each
there is half of their difference.
"""

from functools import cache

import numpy as np

from study.engineering import conductance as joint
from study.engineering.friction import slipping
from study.engineering.impact import thrown
from study.engineering.problems import FINE, elements, names
from study.engineering.submodel import below
from study.engineering.wear import PATH, worn
from study.model.units import dimensionless
from study.run.cases import Case, mark_costly
from study.run.records import read_rows
from study.run.store import Result

SECTION = "W"
TITLE = "What an engineer's answer gains"

Known = dict[str, float] | None

STEPS = 200  # of wear: a fifth of the bound on coarse meshes
FINER = 800


def wear(element: str, reading: str, mesh: int, known: Known = None) -> Result:
    """Depth in the middle of a punch's face at half of the path, over the mean depth there.

    `end_error` is the largest distance of pressures at the end from the mean one, by the best
    reading; `volume_error` that of the worn volume, by the reading's own weights, from k x force x
    path; `step_over_bound` the step over the largest that is stable.
    """
    fine = mesh == FINE["wear"][element.split("-")[1]]
    found = worn(element, reading, mesh, FINER if fine else STEPS)
    scalars = _judged("wear", element, {"": found.half[0] / (PATH / 2)}, known)
    scalars |= {
        "end_error": found.end_error,
        "volume_error": found.volume_error,
        "step_over_bound": found.step_over_bound,
    }
    curves = {
        "x": found.punch.surface.position,
        "half": found.half,
        "depth": found.depth,
        "pressure": found.pressure,
    }
    return _result(scalars, curves, found.punch.dofs)


def friction(element: str, reading: str, mesh: int, known: Known = None) -> Result:
    """Tangential force over mu0 times the pressing one, and half the width that sticks."""
    found = slipping(element, reading, mesh)
    scalars = _judged("friction", element, {"": found.force, "stick_": found.stick}, known)
    curves = {"x": found.x, "pressure": found.pressure, "shear": found.shear}
    return _result(scalars, curves, found.dofs)


def conductance(element: str, reading: str, mesh: int) -> Result:
    """Heat through the joint, and the jump of temperature in its middle."""
    found, known = joint.conducted(element, reading, mesh), _joint(element.split("-")[1])
    scalars = _judged("", "", {"": found.heat, "jump_": found.jump}, known)
    return _result(scalars, {}, found.dofs)


def impact(element: str, mesh: int, known: Known = None) -> Result:
    """Rebound, friction's impulse over mu times the pressing one, and energy that it takes."""
    found = thrown(element, mesh)
    answers = {"": found.rebound, "slip_": found.slip, "energy_": found.energy}
    scalars = _judged("impact", element, answers, known)
    scalars |= {"imbalance": found.imbalance, "steps": float(found.steps)}
    return _result(scalars, {"time": found.time, "force": found.force}, found.dofs)


def submodel(element: str, reading: str, mesh: int) -> Result:
    """Largest stress across the surface on the line below; `field_error` is its L2 error there."""
    found = below(element, reading, mesh)
    known = {"": float(found.exact.max())}
    scalars = _judged("", "", {"": found.stress.max()}, known)
    off = float(np.linalg.norm(found.stress - found.exact) / np.linalg.norm(found.exact))
    return _result(
        scalars | {"field_error": off}, {"stress": found.stress, "exact": found.exact}, found.dofs
    )


def _judged(
    problem: str, element: str, answers: dict[str, float], known: Known
) -> dict[str, float]:
    """Answers by the prefixes of their names, with references and errors."""
    scalars = {}
    for name, reference in (known or fine(problem, element.split("-")[1])).items():
        scalars[f"{name}answer"] = float(answers[name])
        scalars[f"{name}reference"] = reference
        scalars[f"{name}error"] = abs(float(answers[name]) / reference - 1)
    return scalars


def _result(scalars: dict[str, float], curves: dict[str, np.ndarray], dofs: int) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=dofs)


@cache
def _joint(cell: str) -> dict[str, float]:
    known = joint.known(cell)
    return {"": known.heat, "jump_": known.jump}


@cache
def fine(problem: str, cell: str) -> dict[str, float]:
    """Means of both elements' answers on a fine mesh, by the best reading of each."""
    mesh = FINE[problem][cell]
    pairs = []
    for element, reading in _best(problem, cell):
        if problem == "wear":
            depth = worn(element, reading, mesh, FINER).half[0]
            pairs.append({"": depth / (PATH / 2)})
        elif problem == "friction":
            slip = slipping(element, reading, mesh)
            pairs.append({"": slip.force, "stick_": slip.stick})
        else:
            block = thrown(element, mesh)
            pairs.append({"": block.rebound, "slip_": block.slip, "energy_": block.energy})
    return {name: float(np.mean([one[name] for one in pairs])) for name in pairs[0]}


def _best(problem: str, cell: str) -> list[tuple[str, str]]:
    if problem == "impact":
        return [(element, "none") for element in elements(problem, cell)]
    return list(
        zip(elements(problem, cell), ("own" if cell == "T6" else "projected", "own"), strict=True)
    )


RUNS = {run.__name__: run for run in (wear, friction, conductance, impact, submodel)}


def _case(problem: str, element: str, mesh: int, reading: str, known: Known = None) -> Case:
    stated = {"element": element, "reading": reading, "mesh": mesh}
    implied = {"reading": stated.pop("reading")} if problem == "impact" else {}
    if known:
        stated["known"] = known
    return Case("W", f"{problem}-{element}-{mesh}-{reading}", RUNS[problem], stated, implied)


def _cases(cell: str, known: dict[str, Known]) -> list[Case]:
    """All cases on triangles or tetrahedra, but those on fine meshes."""
    return [_case(*name, known.get(problem)) for problem in RUNS for name in names(problem, cell)]


def _recorded() -> dict[str, Known]:
    """References of the plane problems, by their names."""
    return {
        row["parameters"]["problem"]: {
            name.removesuffix("reference"): value
            for name, value in row["scalars"].items()
            if name.endswith("reference")
        }
        for row in read_rows().values()
        if row["section"] == "W" and row["parameters"]["element"].endswith("T6")
    }


CASES = _cases("T6", _recorded())
CASES += mark_costly(
    _cases("T10", {})
    + [
        _case(problem, element, FINE[problem][cell], reading)
        for problem in FINE
        for cell in ("T6", "T10")
        for element, reading in _best(problem, cell)
    ]
)
