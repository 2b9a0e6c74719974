"""Standard element by PETSc's SNES, with pressures from the normal stresses at the surface."""

import ufl
from dolfinx import fem

from study.benchmarks.q_rivals.methods.snes_vi import solve_displacements_below_gap
from study.solutions.hertz_problem import Problem, Solution, make_function, solve_lu

SWEEP = (0.0, 1.0, 2.0)  # 0: discontinuous stresses; 1, 2: degree of projected stresses


def solve(problem: Problem, stress_degree: float) -> Solution:
    """Solve; use discontinuous stresses (`parameter` 0) or their projection to this degree."""
    u, count = solve_displacements_below_gap(problem)
    stress = problem.stress(u)[problem.normal_axis, problem.normal_axis]
    if stress_degree == 0:
        return Solution(u, -stress, u.x.array.size, count, u.function_space)
    Q = fem.functionspace(problem.mesh, ("Lagrange", int(stress_degree)))
    q, s = ufl.TestFunction(Q), ufl.TrialFunction(Q)
    mass = fem.assemble_matrix(fem.form(q * s * ufl.dx)).to_scipy()
    right = fem.assemble_vector(fem.form(-stress * q * ufl.dx)).array
    pressure = make_function(Q, solve_lu(mass, right))
    return Solution(u, pressure, u.x.array.size, count, u.function_space)
