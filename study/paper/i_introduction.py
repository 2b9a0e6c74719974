"""I: what the introduction says of cost and of tensile nodal forces, on two small models."""

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
from study.model.units import dimensionless
from study.run.cases import Case
from study.run.store import Result

SECTION = "I"
TITLE = "The paper's introduction: cost and tensile nodal forces"

# Nothing of this is printed: a block like that of section 7.2, its upper side moved
MATERIAL = Material(1000.0, 0.3)
LENGTH, HEIGHT = 4.0, 2.0
DOWN, ALONG = 0.2, 0.15  # displacement of the upper side
DIVISIONS = (64, 32)
FRICTION = 0.3
SYMMETRIC = 1e-12  # relative difference of a matrix and its transpose

# Row of unit squares whose pressure dips to nothing at a corner node
ROW, ROW_HEIGHT = 8, 0.25


def factors(element: str, friction: float) -> Result:
    """Unsymmetry of the contact problem's last matrix, and what its factors hold.

    The matrix is that of Newton's method on the closed, sticking and sliding nodes of the solution:
    a sliding node's equation is its tangential force less mu times its normal one. Symmetric
    matrices are factorised as L D L^T, others as L U.
    """
    body = discretise(element, _block, MATERIAL, StressState.PLANE_STRESS)
    moved = [prescribe(body.space, 0, _upper_side, ALONG)]
    moved += [prescribe(body.space, 1, _upper_side, -DOWN)]
    pair = ContactPair(_lower_side, Plane((0.0, 0.0), (0.0, 1.0)), friction)
    nothing = [body.K.createVecLeft()]
    state = solve_contact(body.K, nothing, body.supports(moved), [pair], body.space)[-1]
    contact = state.pairs[0]
    tangent = _tangent(body, contact)
    unsymmetry = sp.linalg.norm(tangent - tangent.T) / sp.linalg.norm(tangent)
    scalars = {
        "unsymmetry": float(unsymmetry),
        "entries": _entries(tangent, unsymmetry < SYMMETRIC),
        "sliding": float(np.count_nonzero(contact.status == SLIP)),
        "sticking": float(np.count_nonzero(contact.status == STICK)),
    }
    return Result(scalars, dimensionless(scalars), dofs=tangent.shape[0])


def dip(element: str, refined: int = 1) -> Result:
    """A row of squares on a smooth rigid base, under a pressure that vanishes at one corner node.

    Smallest nodal force on the base over the mean one, and smallest pressure (force over the
    integral of the node's own test function) over the mean one. The base holds the row in both
    directions, so that the forces are those of a linear problem.
    """
    body = discretise(element, partial(_row, refined), MATERIAL, StressState.PLANE_STRESS)
    x = ufl.SpatialCoordinate(body.body.spaces.mesh)
    pressure = (x[0] - ROW / 2) ** 2
    surface = boundary_measure(body.body.spaces.mesh, _top_of_row)
    f = assemble_vector(body.body.surface_load(ufl.as_vector([0.0, -pressure]), surface))
    held = [prescribe(body.space, 1, _lower_side), prescribe(body.space, 0, _left_side)]
    a = solve(body.K, f, body.supports(held))
    force = forces_along(body.space, reactions(body.K, a, f), _lower_side)
    pressures = SurfaceNodes.from_body(body.body, _lower_side).pressure(force.force[:, 1])
    scalars = {
        "smallest_force": force.force[:, 1].min() / force.force[:, 1].mean(),
        "smallest_pressure": pressures.min() / (ROW**2 / 12),
    }
    curves = {"x": force.position[:, 0], "force": force.force[:, 1], "pressure": pressures}
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=body.K.getSize()[0])


def _tangent(body: Discretisation, contact: PairState) -> sp.csr_matrix:
    nodes = body.space.tabulate_dof_coordinates()
    below = np.flatnonzero(_lower_side(nodes.T))
    below = below[np.argsort(nodes[below, 0])]
    held = np.zeros((len(nodes), 2), dtype=bool)
    held[_upper_side(nodes.T)] = True
    held[below[contact.status != OPEN], 1] = True
    held[below[contact.status == STICK], 0] = True
    n = held.size
    right = sp.identity(n, format="csc")[:, np.flatnonzero(~held.ravel())]
    sliding = contact.status == SLIP
    rows = 2 * below[sliding]
    share = -contact.friction[sliding] * contact.direction[sliding, 0]
    law = sp.identity(n, format="csr") + sp.csr_matrix((share, (rows, rows + 1)), shape=(n, n))
    K = sp.csr_matrix(body.K.getValuesCSR()[::-1], shape=(n, n))
    return sp.csr_matrix(right.T @ law @ K @ right)


def _entries(matrix: sp.csr_matrix, symmetric: bool) -> float:
    """Entries of MUMPS' factors."""
    matrix.sort_indices()
    A = PETSc.Mat().createAIJ(
        matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=MPI.COMM_SELF
    )
    factors = Direct().prepare(A, symmetric)
    factors.set_up()
    entries = factors.ksp.getPC().getFactorMatrix().getMumpsInfog(29)
    return float(entries if entries > 0 else -1e6 * entries)


def _block(_: str) -> Mesh:
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, HEIGHT), DIVISIONS, "right")


def _row(refined: int, _: str) -> Mesh:
    divisions = (ROW * refined, refined)
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (float(ROW), ROW_HEIGHT), divisions, "left_right")


def _upper_side(x: np.ndarray) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], HEIGHT)


def _top_of_row(x: np.ndarray) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], ROW_HEIGHT)


def _lower_side(x: np.ndarray) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0)


def _left_side(x: np.ndarray) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


ELEMENTS = ("galerkin-T6", "pw-T6")
CASES = [
    Case("I", f"factors-{element}{suffix}", factors, {"element": element, "friction": friction})
    for element in ELEMENTS
    for suffix, friction in (("", FRICTION), ("-mu0", 0.0))
]
CASES += [Case("I", f"dip-{element}", dip, {"element": element}) for element in ELEMENTS]
CASES += [Case("I", "dip-galerkin-T6-fine", dip, {"element": "galerkin-T6", "refined": 16})]
