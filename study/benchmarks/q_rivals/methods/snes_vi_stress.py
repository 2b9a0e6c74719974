"""The standard element by SNES, with pressures from its stresses."""

import ufl
from dolfinx import fem

from study.benchmarks.q_rivals.methods.snes_vi import solve_displacements
from study.solutions.hertz_problem import Problem, Solution, make_function, solve_lu

SWEEP = (0.0, 1.0, 2.0)  # 0: discontinuous stresses; 1, 2: degree of the projected ones


def solve(problem: Problem, parameter: float) -> Solution:
    """Solve; use stresses as they are (parameter 0) or projected to continuous functions."""
    u, count = solve_displacements(problem)
    stress = problem.stress(u)[problem.normal_axis, problem.normal_axis]
    if parameter == 0:
        return Solution(u, -stress, u.x.array.size, count, u.function_space)
    Q = fem.functionspace(problem.mesh, ("Lagrange", int(parameter)))
    q, s = ufl.TestFunction(Q), ufl.TrialFunction(Q)
    mass = fem.assemble_matrix(fem.form(q * s * ufl.dx)).to_scipy()
    right = fem.assemble_vector(fem.form(-stress * q * ufl.dx)).array
    pressure = make_function(Q, solve_lu(mass, right))
    return Solution(u, pressure, u.x.array.size, count, u.function_space)
