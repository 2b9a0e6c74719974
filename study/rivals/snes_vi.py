"""The standard element by PETSc's SNES for variational inequalities, forces over own weights."""

from petsc4py import PETSc

import ufl
from dolfinx import fem
from dolfinx.fem.petsc import apply_lifting, assemble_matrix, set_bc

from study.rivals.problem import Answer, Problem, direct, function


def displacements(problem: Problem, degree: int = 2) -> tuple[fem.Function, int]:
    """No surface node's displacement exceeds its gap: u, and how many factorisations."""
    V = problem.space(degree)
    u, v, supports = ufl.TrialFunction(V), ufl.TestFunction(V), problem.supports(V)
    form = fem.form(problem.work(u, v))
    K, held = assemble_matrix(form, supports), fem.Function(V)
    K.assemble()
    apply_lifting(f := held.x.petsc_vec, [form], [supports])
    set_bc(f, supports)
    lower, upper = function(V, -PETSc.INFINITY), function(V, PETSc.INFINITY)
    normal = problem.normal(V)
    upper.x.array[normal] = problem.gap_at(V.tabulate_dof_coordinates())[normal // V.dofmap.bs]
    snes = PETSc.SNES().create(K.comm)
    snes.setType("vinewtonrsls")
    snes.setFunction(lambda _, x, F: (K.mult(x, F), F.axpy(-1.0, f)), f.duplicate())
    snes.setJacobian(lambda *_: None, K)
    snes.setVariableBounds(lower.x.petsc_vec, upper.x.petsc_vec)
    snes.setTolerances(atol=0.0, rtol=1e-12, stol=0.0)
    direct(snes.ksp)
    found = fem.Function(V)
    snes.solve(None, found.x.petsc_vec)
    return found, snes.getLinearSolveIterations()


def solve(problem: Problem) -> Answer:
    """Each nodal force is read over the integral of its own shape function."""
    u, count = displacements(problem)
    pressure = problem.over_own_weights(u, u.function_space)
    return Answer(u, pressure, u.x.array.size, count, u.function_space)
