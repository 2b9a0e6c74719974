"""Standard element by PETSc's SNES for variational inequalities; pressures from nodal forces."""

from petsc4py import PETSc

import ufl
from dolfinx import fem
from dolfinx.fem.petsc import apply_lifting, assemble_matrix, set_bc

from study.solutions.hertz_problem import Problem, Solution, make_function, use_mumps_lu


def solve_displacements_below_gap(problem: Problem, degree: int = 2) -> tuple[fem.Function, int]:
    """Solve for displacements bounded by the gap at nodes; return also the factorisation count."""
    V = problem.make_space(degree)
    u, v, supports = ufl.TrialFunction(V), ufl.TestFunction(V), problem.far_field_supports(V)
    form = fem.form(problem.virtual_work(u, v))
    K, load = assemble_matrix(form, supports), fem.Function(V)
    K.assemble()
    apply_lifting(f := load.x.petsc_vec, [form], [supports])
    set_bc(f, supports)
    lower, upper = make_function(V, -PETSc.INFINITY), make_function(V, PETSc.INFINITY)
    normal = problem.normal_dofs_that_may_touch(V)
    upper.x.array[normal] = problem.gap_at(V.tabulate_dof_coordinates())[normal // V.dofmap.bs]
    snes = PETSc.SNES().create(K.comm)
    snes.setType("vinewtonrsls")
    snes.setFunction(lambda _, x, F: (K.mult(x, F), F.axpy(-1.0, f)), f.duplicate())
    snes.setJacobian(lambda *_: None, K)
    snes.setVariableBounds(lower.x.petsc_vec, upper.x.petsc_vec)
    snes.setTolerances(atol=0.0, rtol=1e-12, stol=0.0)
    use_mumps_lu(snes.ksp)
    solution = fem.Function(V)
    snes.solve(None, solution.x.petsc_vec)
    return solution, snes.getLinearSolveIterations()


def solve(problem: Problem) -> Solution:
    """Solve, and divide each nodal contact force by the integral of the node's shape function."""
    u, count = solve_displacements_below_gap(problem)
    pressure = problem.pressure_from_nodal_forces(u, u.function_space)
    return Solution(u, pressure, u.x.array.size, count, u.function_space)
