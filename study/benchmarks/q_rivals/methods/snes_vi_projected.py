"""Standard element by PETSc's SNES, with nodal forces projected to linear pressures."""

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import interpolation_matrix

from study.benchmarks.q_rivals.methods.snes_vi import solve_displacements_below_gap
from study.solutions.hertz_problem import Problem, Solution, make_function, solve_lu


def solve(problem: Problem) -> Solution:
    """Solve; find the linear pressure that does the nodal forces' work on all linear fields."""
    u, count = solve_displacements_below_gap(problem)
    Q1, Q2 = (fem.functionspace(problem.mesh, ("Lagrange", degree)) for degree in (1, 2))
    forces = make_function(Q2, problem.nodal_forces(u, u.function_space)[:, problem.normal_axis])
    nodes = fem.locate_dofs_geometrical(Q1, problem.may_touch)
    surface = fem.locate_dofs_geometrical(Q2, problem.may_touch)
    forces.x.array[np.setdiff1d(np.arange(forces.x.array.size), surface)] = 0.0
    mass = ufl.TrialFunction(Q1) * ufl.TestFunction(Q1) * problem.contact_measure
    M = fem.assemble_matrix(fem.form(mass)).to_scipy()[nodes][:, nodes]
    P = interpolation_matrix(Q1, Q2)
    P.assemble()
    pressure, right = fem.Function(Q1), P.createVecRight()
    P.multTranspose(forces.x.petsc_vec, right)
    pressure.x.array[nodes] = solve_lu(M, right.array_r[nodes])
    return Solution(u, pressure, u.x.array.size, count, u.function_space)
