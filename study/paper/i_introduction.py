"""The paper's introduction: cost of the new element, and tensile nodal forces under pressure."""

from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import ufl
from dolfinx.mesh import Mesh

from pw_elements import (
    Direct,
    Material,
    SurfaceNodes,
    assemble_vector,
    boundary_measure,
    forces_along,
    prescribe,
    reactions,
    solve,
)
from pw_elements.contact import OPEN, SLIP, STICK, ContactPair, Plane, solve_contact
from pw_elements.contact.model import PairState
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from study.model.discretisation import Discretisation, discretise
from study.model.units import assign_unit_one_to_scalars
from study.run.cases import Case
from study.run.store import Result

SECTION = "I"
TITLE = "The paper's introduction: cost and tensile nodal forces"
FACTS = {
    "geometry": "a block 4 × 2 on a rough rigid plane; a row of eight rectangles 1 × 1/4 on a "
    "smooth base",
    "mesh": "64 × 32 squares and 8 × 1 rectangles, each cut into two triangles; the row also "
    "sixteen times finer",
    "material": "linear elastic, plane stress; E = 1000, ν = 0.3",
    "supports": "block: upper side moved, μ = 0.3 or none below; row: vertically along its base, "
    "horizontally at its left side",
    "load": "block: 0.2 down and 0.15 sideways; row: a pressure (x − 4)², which vanishes at a "
    "corner node",
    "reference": "the introduction's words on cost and on tensile nodal forces",
    "uncertainty": "the paper prints no number: both models are this study's choice",
}
SHORT_FACTS = {
    "reference": "the introduction's words on cost and tensile forces",
    "uncertainty": "no number is printed: both models are our choice",
}

# Problem

PROBLEM = r"""
The introduction says that the new element is more expensive, that with friction this may not matter, and that standard
elements can give tensile nodal forces under pressure. It gives no numbers for these statements. They are judged by two
small models: a block of 64 × 32 squares on a rigid surface, its upper side moved down and sideways, with $\mu = 0.3$ and
without friction; and a row of eight rectangles, 1 × 1/4, on a smooth base under a pressure that grows with the square of
the distance from a corner node.
"""

MATERIAL = Material(1000.0, 0.3)

# Block, like that of section 7.2
LENGTH, HEIGHT = 4.0, 2.0
DIVISIONS = (64, 32)
FRICTION = 0.3
DOWNWARD_DISPLACEMENT, SIDEWAYS_DISPLACEMENT = 0.2, 0.15
"""Prescribed displacements of the block's upper side."""

# Row of rectangles
ROW_LENGTH, ROW_HEIGHT = 8, 0.25

# Method

METHOD = r"""
For the block, the matrix of Newton's method at the solution is factorised; the rows of sliding nodes contain Coulomb's
law. Symmetric matrices are factorised as $L D L^\mathrm{T}$ and others as $L U$, both by MUMPS, and the entries of the
factors are counted. For the row, the nodal forces on the base are evaluated.
"""

MAX_ROUND_OFF_ASYMMETRY = 1e-12
"""A matrix whose relative difference from its transpose is below this counts as symmetric."""


def factors(element: str, friction: float) -> Result:
    """Count the entries of the factors of the block's contact matrix at the solution.

    The matrix is that of Newton's method on the closed, sticking and sliding nodes of the solution:
    the equation of a sliding node is its tangential force minus mu times its normal force.
    Symmetric matrices are factorised as L D L^T, others as L U.
    """
    body = discretise(element, _mesh_block, MATERIAL, StressState.PLANE_STRESS)
    supports = [
        prescribe(body.space, 0, _on_upper_side, SIDEWAYS_DISPLACEMENT),
        prescribe(body.space, 1, _on_upper_side, -DOWNWARD_DISPLACEMENT),
    ]
    pair = ContactPair(_on_lower_side, Plane((0.0, 0.0), (0.0, 1.0)), friction)
    no_load = [body.K.createVecLeft()]
    state = solve_contact(body.K, no_load, body.supports(supports), [pair], body.space)[-1]
    contact = state.pairs[0]
    tangent = _assemble_contact_tangent(body, contact)
    unsymmetry = sp.linalg.norm(tangent - tangent.T) / sp.linalg.norm(tangent)
    is_symmetric = unsymmetry < MAX_ROUND_OFF_ASYMMETRY
    scalars = {
        "unsymmetry": float(unsymmetry),
        "entries": _count_factor_entries(tangent, is_symmetric),
        "sliding": float(np.count_nonzero(contact.status == SLIP)),
        "sticking": float(np.count_nonzero(contact.status == STICK)),
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=tangent.shape[0])


def _assemble_contact_tangent(body: Discretisation, contact: PairState) -> sp.csr_matrix:
    """Return the matrix of Newton's method at a contact solution, without prescribed displacements.

    Args:
        body: Discretised block.
        contact: Status and friction of the contact nodes at the solution.
    """
    nodes = body.space.tabulate_dof_coordinates()
    contact_nodes = np.flatnonzero(_on_lower_side(nodes.T))
    contact_nodes = contact_nodes[np.argsort(nodes[contact_nodes, 0])]
    prescribed = np.zeros((len(nodes), 2), dtype=bool)
    prescribed[_on_upper_side(nodes.T)] = True
    prescribed[contact_nodes[contact.status != OPEN], 1] = True
    prescribed[contact_nodes[contact.status == STICK], 0] = True
    n_dofs = prescribed.size
    free_dofs = np.flatnonzero(~prescribed.ravel())
    reduction = sp.identity(n_dofs, format="csc")[:, free_dofs]

    sliding = contact.status == SLIP
    tangential_dofs = 2 * contact_nodes[sliding]
    normal_dofs = tangential_dofs + 1
    normal_factor = -contact.friction[sliding] * contact.direction[sliding, 0]
    coupling = sp.csr_matrix(
        (normal_factor, (tangential_dofs, normal_dofs)), shape=(n_dofs, n_dofs)
    )
    friction_law = sp.identity(n_dofs, format="csr") + coupling
    K = sp.csr_matrix(body.K.getValuesCSR()[::-1], shape=(n_dofs, n_dofs))
    return sp.csr_matrix(reduction.T @ friction_law @ K @ reduction)


def _count_factor_entries(matrix: sp.csr_matrix, is_symmetric: bool) -> float:
    """Factorise a matrix by MUMPS and return the number of entries in the factors.

    MUMPS chooses the ordering for all elements, so that their numbers are comparable.
    """
    matrix.sort_indices()
    A = PETSc.Mat().createAIJ(
        matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=MPI.COMM_SELF
    )
    solver = Direct({"mat_mumps_icntl_7": 7}).prepare(A, is_symmetric)
    solver.set_up()
    entries = solver.ksp.getPC().getFactorMatrix().getMumpsInfog(29)
    # MUMPS returns large numbers in millions, with a negative sign
    return float(entries if entries > 0 else -1e6 * entries)


def dip(element: str, refined: int = 1) -> Result:
    """Solve a row of rectangles on a smooth base under a pressure that dips to zero.

    The pressure vanishes at one corner node. The scalars are the smallest nodal force on the base
    and the smallest pressure (force over the integral of the node's own test function), both
    relative to their means. The base supports the row vertically at all nodes, even in tension, so
    the problem is linear.

    Args:
        element: Name of the element.
        refined: Factor by which the numbers of divisions are multiplied.
    """
    body = discretise(
        element, partial(_mesh_row_of_rectangles, refined), MATERIAL, StressState.PLANE_STRESS
    )
    x = ufl.SpatialCoordinate(body.body.spaces.mesh)
    pressure = (x[0] - ROW_LENGTH / 2) ** 2
    top = boundary_measure(body.body.spaces.mesh, _on_top_of_row)
    f = assemble_vector(body.body.surface_load(ufl.as_vector([0.0, -pressure]), top))
    supports = [
        prescribe(body.space, 1, _on_lower_side),
        prescribe(body.space, 0, _on_left_side),
    ]
    a = solve(body.K, f, body.supports(supports))
    base = forces_along(body.space, reactions(body.K, a, f), _on_lower_side)
    vertical_force = base.force[:, 1]
    base_pressure = SurfaceNodes.from_body(body.body, _on_lower_side).pressure(vertical_force)
    mean_pressure = ROW_LENGTH**2 / 12
    scalars = {
        "smallest_force": float(vertical_force.min() / vertical_force.mean()),
        "smallest_pressure": float(base_pressure.min() / mean_pressure),
    }
    curves = {"x": base.position[:, 0], "force": vertical_force, "pressure": base_pressure}
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=body.K.getSize()[0])


def _mesh_block(_: str) -> Mesh:
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, HEIGHT), DIVISIONS, "right")


def _mesh_row_of_rectangles(refined: int, _: str) -> Mesh:
    upper_corner = (float(ROW_LENGTH), ROW_HEIGHT)
    divisions = (ROW_LENGTH * refined, refined)
    return triangles(MPI.COMM_SELF, (0.0, 0.0), upper_corner, divisions, "left_right")


def _on_upper_side(x: np.ndarray) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], HEIGHT)


def _on_top_of_row(x: np.ndarray) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], ROW_HEIGHT)


def _on_lower_side(x: np.ndarray) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0)


def _on_left_side(x: np.ndarray) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


# Cases

ELEMENTS = ("galerkin-T6", "pw-T6")
CASES = [
    Case("I", f"factors-{element}{suffix}", factors, {"element": element, "friction": friction})
    for element in ELEMENTS
    for suffix, friction in (("", FRICTION), ("-mu0", 0.0))
]
CASES += [Case("I", f"dip-{element}", dip, {"element": element}) for element in ELEMENTS]
CASES += [Case("I", "dip-galerkin-T6-fine", dip, {"element": "galerkin-T6", "refined": 16})]

# Results

RESULT = r"""
{% call table("i-unsymmetry-and-entries-of-the-factors", "Unsymmetry and entries of the factors.") %}
| Element | Friction | Unsymmetry | Entries of the factors | Sliding nodes |
|---|---|---:|---:|---:|
{% for element, words in [("galerkin-T6", "standard T6"), ("pw-T6", "new T6")] %}
{% for suffix, friction in [("", "0.3"), ("-mu0", "none")] %}
{% set key = "I/factors-" ~ element ~ suffix %}
| {{ words }} | {{ friction }} | {{ num(s(key, "unsymmetry"), 2) }} | {{ num(s(key, "entries"), 4) }} | {{ fixed(s(key, "sliding"), 0) }} |
{% endfor %}
{% endfor %}
{% endcall %}

Without friction the factors of the new element have
{{ fixed(measure("factor_entries_ratio", key="I/factors-pw-T6-mu0", other="I/factors-galerkin-T6-mu0"), 2) }} times as
many entries as those of the standard one, and with friction
{{ fixed(measure("factor_entries_ratio", key="I/factors-pw-T6", other="I/factors-galerkin-T6"), 2) }} times as many. In
the row of rectangles, the force of the standard triangle at the corner node without pressure is
{{ num(100 * s("I/dip-galerkin-T6", "smallest_force"), 2) }} % of the mean force, which is tensile. That of the new
triangle is {{ num(100 * s("I/dip-pw-T6", "smallest_force"), 2) }} %, and on a mesh sixteen times finer no pressure is
tensile.
"""
