"""A rubber block under a punch that sticks: a neo-Hookean residual, large strains."""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem

from pw_elements import PetrovGalerkinProblem, draw, prescribe, test_space
from pw_elements.meshes import triangles
from pw_elements import forces_along

cells = 12  # over the height
mu, lame, depth = 1.0, 4.0, 0.35  # MPa, and of the height, which is 1
mesh = triangles(MPI.COMM_WORLD, (-1.5, 0), (1.5, 1), (3 * cells, cells), "crossed")
U = fem.functionspace(mesh, ("Lagrange", 2, (2,)))
u, v = fem.Function(U), ufl.TestFunction(test_space(U))

F = ufl.Identity(2) + ufl.grad(u)
J, cofactor = ufl.det(F), ufl.inv(F).T
stress = mu * (F - cofactor) + lame * ufl.ln(J) * cofactor  # first Piola-Kirchhoff
residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 5})


def punch(x):
    return np.isclose(x[1], 1) & (np.abs(x[0]) < 0.5 + 1e-9)


down = fem.Constant(mesh, -depth)
below = [prescribe(U, i, lambda x: np.isclose(x[1], 0)) for i in (0, 1)]
pressed = [prescribe(U, 0, punch), prescribe(U, 1, punch, down)]
problem = PetrovGalerkinProblem(residual, u, [*below, *pressed])
problem.solve(down, increments=5)
forces = forces_along(U, problem.reactions(), punch)

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
cauchy = stress * F.T / J
draw(mesh, -cauchy[1, 1], u, axes=axes, label="vertical pressure [MPa]",
     colours="magma", limits=(-1, 6))
axes.fill_between([-0.5, 0.5], 1 - depth, 1.1, color="0.6", zorder=0)
x = forces.position[:, 0]
axes.quiver(x, 1 - depth + 0 * x, 0 * x, forces.force[:, 1], color="k", width=2e-3, pivot="tip")
axes.set(xlabel="x [mm]", ylabel="y [mm]")
if mesh.comm.rank == 0:
    figure.savefig("rubber_punch.png", dpi=150)
    print(f"force of the punch: {-forces.force[:, 1].sum():.3f} N/mm")
