"""Linear elements by SNES, the cells cut so that there are as many unknowns."""

from dataclasses import replace

from dolfinx import fem
from dolfinx.mesh import refine

from study.rivals.problem import Answer, Problem, function
from study.rivals.snes_vi import displacements


def solve(problem: Problem) -> Answer:
    """Corners of the cut cells are the nodes of the quadratic elements."""
    problem.mesh.topology.create_entities(1)
    cut = replace(problem, mesh=refine(problem.mesh)[0])
    u, count = displacements(cut, degree=1)
    V, forces = u.function_space, cut.forces(u, u.function_space)[:, cut.up]
    Q = fem.functionspace(cut.mesh, ("Lagrange", 1))
    pressure = function(Q, cut.over_weights(forces, V))
    return Answer(u, pressure, u.x.array.size, count, V)
