"""The standard element by PETSc's SNES for variational inequalities; forces over own weights."""

from petsc4py import PETSc

import ufl
from dolfinx import fem
from dolfinx.fem.petsc import apply_lifting, assemble_matrix, set_bc

from study.solutions.hertz_problem import Problem, Solution, make_function, use_lu


def solve_displacements(problem: Problem, degree: int = 2) -> tuple[fem.Function, int]:
    """Return displacements that exceed the gap at no node, and the number of factorisations."""
    V = problem.make_space(degree)
    u, v, supports = ufl.TrialFunction(V), ufl.TestFunction(V), problem.far_field_supports(V)
    form = fem.form(problem.virtual_work(u, v))
    K, load = assemble_matrix(form, supports), fem.Function(V)
    K.assemble()
    apply_lifting(f := load.x.petsc_vec, [form], [supports])
    set_bc(f, supports)
    lower, upper = make_function(V, -PETSc.INFINITY), make_function(V, PETSc.INFINITY)
    normal = problem.normal_dofs(V)
    upper.x.array[normal] = problem.gap_at(V.tabulate_dof_coordinates())[normal // V.dofmap.bs]
    snes = PETSc.SNES().create(K.comm)
    snes.setType("vinewtonrsls")
    snes.setFunction(lambda _, x, F: (K.mult(x, F), F.axpy(-1.0, f)), f.duplicate())
    snes.setJacobian(lambda *_: None, K)
    snes.setVariableBounds(lower.x.petsc_vec, upper.x.petsc_vec)
    snes.setTolerances(atol=0.0, rtol=1e-12, stol=0.0)
    use_lu(snes.ksp)
    solution = fem.Function(V)
    snes.solve(None, solution.x.petsc_vec)
    return solution, snes.getLinearSolveIterations()


def solve(problem: Problem) -> Solution:
    """Solve and divide each nodal force by the integral of its node's shape function."""
    u, count = solve_displacements(problem)
    pressure = problem.nodal_pressure(u, u.function_space)
    return Solution(u, pressure, u.x.array.size, count, u.function_space)
