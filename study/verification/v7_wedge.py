"""A wedge pushed up a rough incline against springs: NAFEMS CGS-4."""

from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import (
    Material,
    SurfaceNodes,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
)
from pw_elements.contact import OPEN, SLIP, ContactPair, FreeBody, Plane, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from study.model.contact_result import CONTACT_UNITS
from study.model.discretisation import Discretisation, discretise, mesh_curves
from study.model.units import SI, dimensionless, units_of
from study.run.cases import Case
from study.run.store import Result
from study.solutions.stick_slip import (
    WEDGE_PUSH,
    WEDGE_SLOPE,
    WEDGE_SPRINGS,
    WEDGE_WEIGHT,
    wedge_ratio,
)

SECTION = "V7"
TITLE = "Wedge sliding up a rough incline"

Array = npt.NDArray[np.float64]

# The answer is statics alone: it depends neither on the wedge's shape nor on its material,
# which are chosen here so that no corner lifts; the springs have to count as support, which
# they do not if the body is 1e8 times as stiff
LENGTH, HEIGHT = 4.0, 1.2  # in m; the lower side rises by the slope from 0 at the left
YOUNGS_MODULUS, POISSONS_RATIO = 1e7, 0.3
INCREMENTS = 5  # of the push, after the weight
HALVINGS = 20  # of the interval that encloses the push at which the free wedge slides


def sliding(element: str, friction: float, divisions: tuple[int, int]) -> Result:
    """Mean displacement of the left side, on which springs hold and the push acts.

    Scalars besides the usual ones: `sliding` and `sliding_known`, in m; `ratio` of the
    horizontal to the vertical contact force, and `ratio_known`.
    """
    wedge = _wedge(element, divisions)
    spring = WEDGE_SPRINGS[friction]
    sprung = Discretisation(element, wedge.body, wedge.K + _springs(wedge, spring))
    weight, push = _weight(wedge), _push(wedge)
    loads = [weight + push * (k / INCREMENTS) for k in range(INCREMENTS + 1)]
    states = _on_incline(sprung, loads, friction)

    (contact,) = states[-1].pairs
    force_n, force_t = contact.force_normal, -contact.force_tangential @ _uphill()
    surface = SurfaceNodes.from_body(wedge.body, _base)
    pressure, closed = surface.pressure(force_n), contact.status != OPEN
    ratio = wedge_ratio(WEDGE_SLOPE, friction)
    scalars = {
        "force_normal": force_n.sum(),
        "force_tangential": force_t.sum(),
        "iterations": sum(state.iterations for state in states),
        "residual": max(state.residuals.largest() for state in states),
        "sawtooth": surface.sawtooth(force_n, closed),
        "peak_pressure": pressure.max(),
        "slipping": np.mean(contact.status == SLIP),
        "sliding": _mean_displacement(wedge, states[-1].displacement),
        "sliding_known": (WEDGE_PUSH - WEDGE_WEIGHT * ratio) / spring,
        "ratio": -contact.force[0] / contact.force[1],
        "ratio_known": ratio,
    }
    curves: dict[str, np.ndarray] = {
        "x": contact.position[:, 0],
        "force_n": force_n,
        "force_t": force_t,
        "pressure": pressure,
        "shear": surface.pressure(force_t),
        "status": contact.status,
        **mesh_curves(wedge.space),
    }
    kinds = {**CONTACT_UNITS, "slipping": "1", "sliding*": "length", "ratio*": "1"}
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, units_of(numbers, kinds, SI), curves, dofs=wedge.K.getSize()[0])


def limit(element: str, friction: float, divisions: tuple[int, int]) -> Result:
    """Push at which the wedge without springs begins to slide, over its weight.

    The interval from a push that needs no friction to twice the known limit is halved again
    and again; `holds` is the largest push with an equilibrium, `slides` the smallest without.
    """
    wedge = _wedge(element, divisions)
    weight, push = _weight(wedge), _push(wedge) * (WEDGE_WEIGHT / WEDGE_PUSH)
    known = wedge_ratio(WEDGE_SLOPE, friction)
    holds, slides = WEDGE_SLOPE, 2 * known
    for _ in range(HALVINGS):
        tried = (holds + slides) / 2
        loads = [weight + push * WEDGE_SLOPE, weight + push * tried]
        try:
            _on_incline(wedge, loads, friction)
        except FreeBody:
            slides = tried
        else:
            holds = tried
    scalars = {"holds": holds, "slides": slides, "ratio_known": known}
    return Result(scalars, dimensionless(scalars), dofs=wedge.K.getSize()[0])


def _on_incline(
    wedge: Discretisation, loads: list[PETSc.Vec], friction: float
) -> list[ContactState]:
    normal = (-_uphill()[1], _uphill()[0])
    incline = ContactPair(_base, Plane((0.0, 0.0), normal), friction)
    return solve_contact(wedge.K, loads, wedge.supports([]), [incline], wedge.space)


def _wedge(element: str, divisions: tuple[int, int]) -> Discretisation:
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    return discretise(element, partial(_mesh, divisions), material, StressState.PLANE_STRAIN)


def _mesh(divisions: tuple[int, int], cell: str) -> Mesh:
    def raised(x: Array) -> Array:
        moved = x.copy()
        moved[:, 1] += WEDGE_SLOPE * x[:, 0] * (1 - x[:, 1] / HEIGHT)
        return moved

    build = triangles if cell == "triangle" else quadrilaterals
    return move_nodes(build(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, HEIGHT), divisions), raised)


def _weight(wedge: Discretisation) -> PETSc.Vec:
    area = LENGTH * (HEIGHT - WEDGE_SLOPE * LENGTH / 2)
    return assemble_vector(wedge.body.body_load((0.0, -WEDGE_WEIGHT / area)))


def _push(wedge: Discretisation) -> PETSc.Vec:
    return wedge.surface_load((WEDGE_PUSH / HEIGHT, 0.0), _left)


def _springs(wedge: Discretisation, stiffness: float) -> PETSc.Mat:
    """Horizontal springs spread over the left side."""
    spaces = wedge.body.spaces
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    side = boundary_measure(spaces.mesh, _left)
    return assemble_matrix(stiffness / HEIGHT * u[0] * v[0] * side)


def _mean_displacement(wedge: Discretisation, displacement: PETSc.Vec) -> float:
    """Horizontal displacement of the left side."""
    u = as_function(wedge.space, displacement)
    side = boundary_measure(wedge.body.spaces.mesh, _left)
    return float(fem.assemble_scalar(fem.form(u[0] / HEIGHT * side)))


def _uphill() -> Array:
    """Unit vector."""
    return np.array([1.0, WEDGE_SLOPE]) / np.hypot(1.0, WEDGE_SLOPE)


def _base(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], WEDGE_SLOPE * x[0])


def _left(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
DIVISIONS = ((8, 2), (16, 4), (32, 8))
ROUGHEST = max(WEDGE_SPRINGS)
CASES = [
    Case(
        "V7",
        f"{element}-mu{friction}-{divisions[0]}x{divisions[1]}",
        sliding,
        {"element": element, "friction": friction, "divisions": divisions},
    )
    for element in ELEMENTS
    for friction in WEDGE_SPRINGS
    for divisions in (DIVISIONS if friction == ROUGHEST else DIVISIONS[1:2])
]
CASES += [
    Case(
        "V7",
        f"{element}-limit",
        limit,
        {"element": element, "friction": ROUGHEST, "divisions": DIVISIONS[0]},
    )
    for element in ("galerkin-T6", "pw-T6")
]
