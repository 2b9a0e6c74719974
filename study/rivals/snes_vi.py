"""The standard element by PETSc's SNES for variational inequalities, forces over own weights."""

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import apply_lifting, assemble_matrix, assemble_vector

from study.rivals.problem import Answer, Problem, function


def displacements(problem: Problem, degree: int = 2) -> tuple[fem.Function, int]:
    """No surface node's displacement exceeds its gap: u, and how many factorisations."""
    V = problem.space(degree)
    u, v, supports = ufl.TrialFunction(V), ufl.TestFunction(V), problem.supports(V)
    form, zero = fem.form(problem.work(u, v)), ufl.inner(fem.Function(V), v) * ufl.dx
    K, f = assemble_matrix(form, supports), assemble_vector(fem.form(zero))
    K.assemble()
    apply_lifting(f, [form], [supports])
    fem.petsc.set_bc(f, supports)
    lower, upper = function(V, -np.inf), function(V, np.inf)
    normal = problem.normal(V)
    upper.x.array[normal] = problem.gap_at(V.tabulate_dof_coordinates())[normal // V.dofmap.bs]
    snes = PETSc.SNES().create(K.comm)
    snes.setType("vinewtonrsls")
    snes.setFunction(lambda _, x, F: (K.mult(x, F), F.axpy(-1.0, f)), f.duplicate())
    snes.setJacobian(lambda *_: None, K)
    snes.setVariableBounds(lower.x.petsc_vec, upper.x.petsc_vec)
    snes.setTolerances(atol=0.0, rtol=1e-12, stol=0.0)
    snes.ksp.setType("preonly")
    snes.ksp.pc.setType("lu")
    found = fem.Function(V)
    snes.solve(None, found.x.petsc_vec)
    return found, snes.getLinearSolveIterations()


def solve(problem: Problem) -> Answer:
    """Each nodal force is read over the integral of its own shape function."""
    u, count = displacements(problem)
    forces = problem.forces(u, u.function_space)[:, problem.up]
    pressure = problem.joined(problem.over_weights(forces, u.function_space))
    return Answer(u, pressure, u.x.array.size, count, u.function_space)
