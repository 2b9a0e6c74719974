"""Heat through a joint whose conductance grows with the pressure as h = h0 (p / p0)^.95.

Below Hertz' contact heat flows from the far sides, at the temperature 1, through the joint into
the indenter, at 0; besides the surface is insulated. Conductivity and half width are one. Joints
conduct at nodes, h(p) times the node's own weight. The power is M. M. Yovanovich's; of h linear in
p the heat at an even temperature is that of the total force, whatever the nodal forces.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import ufl
from dolfinx import fem

from pw_elements import Spaces, SurfaceNodes, assemble_matrix
from study.engineering.indented import Indented
from study.engineering.readings import reading as read_by
from study.meshes.mesh_lines import PLACE
from study.rivals.problem import Problem, line, solved, sphere

Array = npt.NDArray[np.float64]

STRENGTH, POWER = 2.0, 0.95  # h0; of the pressure
FINE = {"T6": 48, "T10": 12}  # edges of the reference, which has Hertz' pressure


class Heat(NamedTuple):
    """Heat through the joint, the temperature in its middle, and unknowns."""

    heat: float
    jump: float
    dofs: int


def conducted(element: str, reading: str, edges: int, power: float = POWER) -> Heat:
    """Heat with the pressures of an element, on its own mesh and by its own test functions."""
    contact = Indented.of(element, edges)
    problem, surface = contact.problem, contact.surface
    make = Spaces.petrov_galerkin if element.startswith("pw") else Spaces.galerkin
    spaces = make(problem.mesh, 0)
    pressure = np.maximum(0.0, read_by(reading, surface) @ contact.force) / problem.known.peak
    joint = np.zeros(spaces.trial.dofmap.index_map.size_local)
    own = SurfaceNodes.from_scalar_spaces(spaces, problem.touching)
    joint[own.node] = STRENGTH * pressure**power * own.weight_area
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    indptr, indices, values = K.getValuesCSR()
    matrix = sp.csr_matrix((values, indices, indptr)) + sp.diags(joint)
    T = _solved(problem, matrix, spaces.trial)
    return Heat(float(joint @ T), float(T[own.node[_middle(own)]]), len(T))


def known(cell: str) -> Heat:
    """Heat of Hertz' exact pressure on a fine mesh of standard elements."""
    problem = (line if cell == "T6" else sphere)(FINE[cell], PLACE)
    spaces = Spaces.galerkin(problem.mesh, 0)
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.trial)
    exact = ufl.sqrt(ufl.max_value(0.0, 1 - problem.distance**2))
    law = STRENGTH * exact**POWER
    form = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx + law * u * v * problem.surface
    T = _solved(problem, fem.assemble_matrix(fem.form(form)).to_scipy(), spaces.trial)
    field = fem.Function(spaces.trial)
    field.x.array[:] = T
    own = SurfaceNodes.from_scalar_spaces(spaces, problem.touching)
    heat = float(fem.assemble_scalar(fem.form(law * field * problem.surface)))
    return Heat(heat, float(T[own.node[_middle(own)]]), len(T))


def _solved(problem: Problem, K: sp.csr_matrix, space: fem.FunctionSpace) -> Array:
    """Temperatures (n,), with those of the far sides."""
    x = space.tabulate_dof_coordinates()
    far = np.isclose(np.abs(x[:, : problem.up + 1]).max(axis=1), problem.outer)
    T = far.astype(float)
    T[~far] = solved(K[~far][:, ~far], -(K[~far][:, far] @ T[far]))
    return T


def _middle(surface: SurfaceNodes) -> int:
    return int(np.linalg.norm(surface.position, axis=1).argmin())
