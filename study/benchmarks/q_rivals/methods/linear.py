"""Linear elements by PETSc's SNES, on a refined mesh with the unknowns of quadratic elements."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from study.benchmarks.q_rivals.methods.snes_vi import solve_displacements_below_gap
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.solid_meshes import mesh_box_along_lines
from study.solutions.hertz_problem import Problem, Solution, make_function


def solve(problem: Problem) -> Solution:
    """Solve with linear elements on a mesh whose vertices are the nodes of quadratic elements."""
    coordinates = problem.mesh.geometry.x[:, : problem.normal_axis + 1]
    lines = [np.unique(x.round(12)) for x in coordinates.T]
    x, y, *z = [np.interp(np.arange(0, len(x) - 0.5, 0.5), np.arange(len(x)), x) for x in lines]
    mesh = (
        mesh_box_along_lines("tetrahedron", x, y, *z)
        if z
        else mesh_along_lines(MPI.COMM_SELF, x, y, "triangle")
    )
    refined = replace(problem, mesh=mesh)
    u, count = solve_displacements_below_gap(refined, degree=1)
    V, forces = u.function_space, refined.nodal_forces(u, u.function_space)[:, refined.normal_axis]
    Q = fem.functionspace(refined.mesh, ("Lagrange", 1))
    pressure = make_function(Q, refined.divide_by_test_function_integrals(forces, V))
    return Solution(u, pressure, u.x.array.size, count, V)
