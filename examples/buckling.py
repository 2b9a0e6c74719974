"""Buckling of a frame: a portal whose two columns carry a heavy beam.

A prestress under unit load, then the load's factors at which the frame sways or bows aside.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
from dolfinx.mesh import CellType, create_rectangle, create_submesh, locate_entities

from pw_elements import (
    Body, Material, Reduction, Spaces, as_function, assemble_matrix, assemble_vector,
    boundary_measure, buckling, draw, prescribe, solve,
)

cells = 2  # across a column
width, height, column, beam = 3.0, 4.0, 0.1, 0.2  # m
comm, n = MPI.COMM_WORLD, round(10 * cells)  # squares of so many to the metre
grid = create_rectangle(
    comm, [[0, 0], [width, height]], [round(width * n), round(height * n)], CellType.quadrilateral
)


def in_frame(x):
    in_column = np.abs(x[0] - width / 2) > width / 2 - column - 1e-9
    return in_column | (x[1] > height - beam - 1e-9)


frame = locate_entities(grid, 2, in_frame)
mesh = create_submesh(grid, 2, frame)[0]
steel = Body(Spaces.petrov_galerkin(mesh), Material(210e9, 0.3), "plane stress", thickness=0.1)
U = steel.spaces.trial

K = assemble_matrix(steel.stiffness())
top = boundary_measure(mesh, lambda x: np.isclose(x[1], height))
load = 1e6  # N, over the whole beam
f = assemble_vector(steel.surface_load((0, -load / (width * 0.1)), top))
feet = [prescribe(U, i, lambda x: np.isclose(x[1], 0)) for i in (0, 1)]
held = Reduction.dirichlet(U, feet)
prestress = steel.stress(as_function(U, solve(K, f, held)))
K_sigma = assemble_matrix(steel.geometric_stiffness(prestress))
modes = buckling(K, K_sigma, held, count=3)

figure, axes = plt.subplots(1, 3, figsize=(9, 4.2), layout="constrained")
for ax, factor, shape in zip(axes, modes.factors, modes.shapes, strict=True):
    u = as_function(U, shape)
    draw(mesh, axes=ax, edges=False)
    draw(mesh, u[0] ** 2 + u[1] ** 2, u, scale=0.4, axes=ax, edges=False, colours="plasma")
    ax.set(title=f"{factor * load / 1e6:.1f} MN", xlabel="x [m]")
axes[0].set(ylabel="y [m]")
if comm.rank == 0:
    figure.savefig("buckling.png", dpi=150)
