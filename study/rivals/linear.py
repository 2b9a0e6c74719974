"""Linear elements by SNES, the cells cut so that there are as many unknowns."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from study.meshes.line_mesh import on_lines
from study.meshes.solid_meshes import box
from study.rivals.problem import Answer, Problem, function
from study.rivals.snes_vi import displacements


def solve(problem: Problem) -> Answer:
    """Corners of the cut cells are the nodes of the quadratic elements."""
    places = problem.mesh.geometry.x[:, : problem.up + 1]
    lines = [np.unique(x.round(12)) for x in places.T]
    x, y, *z = [np.interp(np.arange(0, len(x) - 0.5, 0.5), np.arange(len(x)), x) for x in lines]
    mesh = box("tetrahedron", x, y, *z) if z else on_lines(MPI.COMM_SELF, x, y, "triangle")
    cut = replace(problem, mesh=mesh)
    u, count = displacements(cut, degree=1)
    V, forces = u.function_space, cut.forces(u, u.function_space)[:, cut.up]
    Q = fem.functionspace(cut.mesh, ("Lagrange", 1))
    pressure = function(Q, cut.over_weights(forces, V))
    return Answer(u, pressure, u.x.array.size, count, V)
