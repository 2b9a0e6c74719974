"""Heat out of an L-shaped chip: Petrov-Galerkin Poisson, and the flux at its rim.

The standard element's nodal heat alternates between mid-sides and corners; the new element's is the
flux times the length of boundary that belongs to the node.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx.mesh import CellType, create_rectangle, create_submesh, locate_entities

from pw_elements import (
    Reduction, Spaces, as_function, assemble_matrix, assemble_vector, draw, nodal_flux,
    prescribe, reactions, solve,
)

cells = 16  # along each side
comm = MPI.COMM_WORLD
square = create_rectangle(comm, [[0, 0], [2, 2]], [cells, cells], CellType.triangle)
L = locate_entities(square, 2, lambda x: (x[0] < 1 + 1e-9) | (x[1] < 1 + 1e-9))
mesh = create_submesh(square, 2, L)[0]


def heat_at(side, spaces):
    """Temperature, and the heat that leaves the nodes of a side."""
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(v * ufl.dx)
    held = Reduction.dirichlet(spaces.trial, prescribe(spaces.trial, 0, rim))
    a = solve(K, f, held)
    return as_function(spaces.trial, a), nodal_flux(spaces, reactions(K, a, f), side)


def rim(x):
    inner = (x[0] > 1 - 1e-9) & (x[1] > 1 - 1e-9)
    return np.isclose(x[0], 0) | np.isclose(x[1], 0) | np.isclose(x, 2).any(axis=0) | inner


def below(x):
    return np.isclose(x[1], 0)


ways = {"standard": Spaces.galerkin(mesh, 0), "piecewise linear": Spaces.petrov_galerkin(mesh, 0)}
figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4), layout="constrained")
for (name, spaces), style in zip(ways.items(), ("^--", "o-"), strict=True):
    temperature, heat = heat_at(below, spaces)
    right.plot(heat.surface.position[:, 0], -heat.reaction, style, ms=4, lw=1, label=name)
draw(mesh, temperature, axes=left, label="temperature", colours="inferno")
right.set(xlabel="x", ylabel="heat out of each node of the lower side")
right.legend(frameon=False)
if comm.rank == 0:
    figure.savefig("poisson.png", dpi=150)
