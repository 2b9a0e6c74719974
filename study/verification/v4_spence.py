"""Spence's problem: how far a flat punch with friction sticks to a half plane."""

from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import Material, prescribe
from pw_elements.contact import STICK, ContactPair, FlatPunch, Motion, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_lines import growing
from study.model.contact_result import contact_result
from study.model.discretisation import Discretisation, discretise
from study.model.units import NONE
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions.half_space import Elastic
from study.solutions.stick_slip import SPENCE

SECTION = "V4"
TITLE = "Stick radius below a flat punch with friction"

Array = npt.NDArray[np.float64]

# Right half of the body; lengths over the punch's half width b, force over E b. The stick
# radius depends on nu and mu alone.
YOUNGS_MODULUS, FORCE = 1.0, 1e-3
OUTER, GROWTH = 5.0, 1.3  # the body's sides; growth of elements beside and below the punch
EDGE = 0.25  # size of the element at the edge over that of the others below the punch
COARSEST = 16  # elements below half of the punch
INCREMENTS = 2
PASSES = 2  # far fields, each of the nodal forces computed with the one before


def stick_radius(
    element: str,
    poissons_ratio: float,
    friction: float,
    elements: int,
    far_field: bool = True,
    increments: int = INCREMENTS,
    state: str = "plane strain",
) -> Result:
    """Contact below the punch; `stick` is the stick radius over its half width.

    It is the middle between the last node that sticks and the first that slips; their distance is
    `stick_between`. The sides have the displacements of a half plane under the nodal forces, or are
    held. Each mesh starts from the forces of the next coarser one. `pass_change` is the largest
    change of a nodal force by the last far field, over the largest force.
    """
    plane_strain = _in_plane_strain(YOUNGS_MODULUS, poissons_ratio, StressState(state))
    steps = np.arange(1, increments + 1) / increments
    down = [Motion((0.0, None), (0.0, -FORCE / 2 * step)) for step in steps]
    pair = ContactPair(_below, FlatPunch((0.0, 0.0), (0.0, -1.0), 1.0), friction, down)
    forces = np.array([[0.0, FORCE / 2, 0.0]])  # places, pressing, pulling; of the right half
    for level in COARSEST * 2 ** np.arange(1 + int(np.log2(elements // COARSEST))):
        body = discretise(
            element,
            partial(_mesh, int(level)),
            Material(YOUNGS_MODULUS, poissons_ratio),
            StressState(state),
        )
        held = [prescribe(body.space, i, _sides) for i in (0, 1)]
        sides = body.supports([*held, prescribe(body.space, 0, _axis)])
        for _ in range(PASSES if far_field else 1):
            full = _held_sides(body, plane_strain, forces if far_field else forces[:0])
            loads = [full * step for step in steps]
            before = forces
            states = solve_contact(body.K, loads, sides, [pair], body.space)
            (contact,) = states[-1].pairs
            tangential = contact.force_tangential[:, 0]
            forces = np.column_stack([contact.position[:, 0], contact.force_normal, tangential])
    change = np.abs(forces - before).max() / forces.max() if far_field else 0.0
    last_sticking, first_slipping = _border(states[-1])
    known = SPENCE.get((poissons_ratio, friction)) if state == "plane strain" else None
    return contact_result(
        body,
        states,
        loads[-1],
        _below,
        FORCE / 2,
        NONE,
        kinds={"stick*": "1", "pass_change": "1"},
        stick=(first_slipping + last_sticking) / 2,
        stick_between=first_slipping - last_sticking,
        pass_change=change,
        **({} if known is None else {"stick_known": known}),
    )


def _in_plane_strain(E: float, nu: float, state: StressState) -> Elastic:
    """The material in plane strain whose plane problems are those of the given state."""
    if state is StressState.PLANE_STRAIN:
        return Elastic(E, nu)
    return Elastic(E * (1 + 2 * nu) / (1 + nu) ** 2, nu / (1 + nu))


def _held_sides(body: Discretisation, half_plane: Elastic, forces: Array) -> PETSc.Vec:
    """Load that stands for displacements of the sides, which the supports then hold.

    `forces` (m, 3) are places, pressing and pulling forces of the right half.
    """
    nodes = fem.locate_dofs_geometrical(body.space, _sides)
    x = body.space.tabulate_dof_coordinates()[nodes, :2]
    s, pressing, pulling = forces.T
    moved = body.K.createVecRight()
    moved.array.reshape(-1, 2)[nodes] = half_plane.line_displacement(
        x, np.r_[s, -s], np.r_[pressing, pressing], np.r_[pulling, -pulling]
    )
    load = body.K * moved
    load.scale(-1.0)
    return load


def _border(state: ContactState) -> tuple[float, float]:
    """Places of the last sticking node and of the next one."""
    x, status = state.pairs[0].position[:, 0], state.pairs[0].status
    last = int(np.flatnonzero(status == STICK).max())
    return float(x[last]), float(x[last + 1])


def _mesh(elements: int, cell: str) -> Mesh:
    # the size falls linearly from the middle to the edge
    s = np.linspace(0.0, 1.0, elements + 1)
    below = 2 / (1 + EDGE) * (s - (1 - EDGE) / 2 * s**2)
    smallest = below[-1] - below[-2]
    x_lines = np.concatenate([below, 1 + growing(smallest, OUTER - 1, GROWTH)[1:]])
    y_lines = -growing(smallest, OUTER, GROWTH)[::-1]
    return on_lines(MPI.COMM_SELF, x_lines, y_lines, cell, "left_right")


def _below(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0) & (x[0] < 1 + 1e-9)


def _axis(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


def _sides(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], OUTER) | np.isclose(x[1], -OUTER)


ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
LEVELS = (16, 32, 64)
FINEST = 128
FIRST = next(iter(SPENCE))


def case_name(element: str, poissons_ratio: float, friction: float, elements: int) -> str:
    """Name of a case, friction as an angle in degrees."""
    angle = np.rad2deg(np.arctan(friction))
    return f"{element}-nu{poissons_ratio:.2f}-{angle:.1f}deg-{elements}"


def _case(
    element: str, material: tuple[float, float], elements: int, variant: str = "", **other: object
) -> Case:
    nu, mu = material
    name = case_name(element, nu, mu, elements) + variant
    parameters = {"element": element, "poissons_ratio": nu, "friction": mu, "elements": elements}
    return Case("V4", name, stick_radius, parameters | other)


_OTHERS = list(SPENCE)[1:]
CASES = [_case(element, FIRST, n) for element in ELEMENTS for n in LEVELS]
CASES += [_case(element, FIRST, FINEST) for element in ("galerkin-T6", "pw-T6")]
CASES += [_case("pw-T6", material, n) for material in _OTHERS for n in (64, FINEST)]
CASES += [
    _case("pw-T6", FIRST, 32, "-one-step", increments=1),
    _case("pw-T6", FIRST, 32, "-ten-steps", increments=10),
    _case("pw-T6", FIRST, 64, "-held", far_field=False),
    _case("pw-T6", (0.25, FIRST[1]), 64, "-stress", state="plane stress"),
]
CASES = mark_costly(CASES, "*-128", "composite-*-64", "*-Q[89]-*-64")
