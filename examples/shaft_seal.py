"""The rubber lip of a seal slid over a shaft's shoulder: two bodies at large strains and sliding.

The lip's back is pressed down, then moved along the shaft. Who faces whom is found anew in each
iteration, so that the lip may slide over any number of the shaft's elements.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import create_submesh, locate_entities, locate_entities_boundary

from pw_elements import Spaces, draw, prescribe
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from pw_elements.meshes import move_nodes, triangles

cells = 10  # over the lip's width
width, gap, rise, friction = 0.8, 0.01, 0.1, 0.3  # mm
down, way, steps = 0.12, 1.6, 16  # of the lip's back, at x = -0.8 at first

row, rows = 0.8 / cells, cells + cells // 2 + 1  # one of which is no cells, but the gap
grid = (-2 * width, -0.4), (2 * width, row + 0.8), (4 * cells, rows)
whole = triangles(MPI.COMM_WORLD, *grid)
shaft = locate_entities(whole, 2, lambda x: x[1] < row / 2)
lip = locate_entities(whole, 2, lambda x: (x[1] > row / 2) & (np.abs(x[0] + 0.8) < 0.401))


def shaped(p):
    x, y, up = p[:, 0], p[:, 1], (p[:, 1] - row) / 0.8
    shoulder = rise * (1 + np.tanh(x / 0.15)) / 2
    lip = gap + up * (0.8 - gap) + 1.2 * (x + 0.8) ** 2 * (1 - up)
    return np.stack([x, np.where(y < row / 2, y + (1 + y / 0.4) * shoulder, lip)], axis=1)


mesh = move_nodes(create_submesh(whole, 2, np.union1d(shaft, lip))[0], shaped)
spaces = Spaces.petrov_galerkin(mesh)
u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
mu = fem.Function(fem.functionspace(mesh, ("DG", 0)))  # MPa; the shaft is 50 times as stiff
mu.interpolate(lambda x: np.where(x[1] < rise * (1 + np.tanh(x[0] / 0.15)) / 2, 50.0, 1.0))
F = ufl.Identity(2) + ufl.grad(u)
J, F_T = ufl.det(F), ufl.inv(F).T
stress = mu * (F - F_T + 4 * ufl.ln(J) * F_T)  # first Piola-Kirchhoff
residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})

back = [fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)]
held = [prescribe(spaces.trial, i, lambda x: np.isclose(x[1], -0.4)) for i in (0, 1)]
held += [prescribe(spaces.trial, i, lambda x: np.isclose(x[1], 0.8), back[i]) for i in (0, 1)]


def profile(x):
    return np.isclose(x[1], rise * (1 + np.tanh(x[0] / 0.15)) / 2, atol=1e-9)


def tip(x):
    return np.isclose(x[1], gap + 1.2 * (x[0] + 0.8) ** 2) & (np.abs(x[0] + 0.8) < 0.401)


under = fem.locate_dofs_topological(spaces.trial, 1, locate_entities_boundary(mesh, 1, tip))
pair = ContactPair(under, DeformableSurface(profile, revolved=False), friction=friction)
problem = ContactProblem.of_residual(residual, u, held, pair)


def move(across, depth):
    back[0].value, back[1].value = across, -depth


state = problem.step(problem.undeformed, lambda share: move(0.0, share * down))
forces, places = [], np.arange(1, steps + 1) * way / steps
for k in range(steps):
    state = problem.step(state, lambda share, k=k: move((k + share) * way / steps, down))
    forces.append(-state.pairs[0].opposite_force.sum(axis=0))
forces = np.array(forces)

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
draw(mesh, -(stress * F.T / J)[1, 1], u, axes=left, label="vertical pressure [MPa]",
     limits=(-0.2, 1.4))
left.set(xlabel="x [mm]", ylabel="y [mm]")
right.plot(places - 0.8, forces[:, 1], label="normal")
right.plot(places - 0.8, -forces[:, 0], label="against the way")
right.set(xlabel="place of the lip [mm]", ylabel="force on the lip [N/mm]", ylim=(0, None))
right.legend()
if mesh.comm.rank == 0:
    figure.savefig("shaft_seal.png", dpi=150)
    print(f"N {forces[-1, 1]:.3f} and T {-forces[-1, 0]:.3f} N/mm on the shoulder")
