"""A clip snapped onto a catch: two bodies of tetrahedra that slide on each other in space.

The clip is a beam with a rounded head, clamped in a slide that pushes it. The head climbs the
catch, which bends the beam, and snaps down behind it. Who faces whom is found anew in each
iteration.
"""

from functools import partial

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import (
    CellType, create_box, create_submesh, locate_entities, locate_entities_boundary,
)

from pw_elements import Spaces, draw, prescribe
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from pw_elements.meshes import move_nodes

size = 0.2  # of the cells along the beam, in mm
height, half, friction = 0.25, 0.8, 0.2  # height and half length of both bumps in mm

grid = [[-4.0, -0.5, 0.0], [2.0, 0.5, 5.0]], [round(6 / size), 2, 5]
whole = create_box(MPI.COMM_WORLD, *grid, CellType.tetrahedron)
catch = locate_entities(whole, 3, lambda x: (x[2] < 2.01) & (x[0] > -0.01))
clip = locate_entities(whole, 3, lambda x: (x[2] > 2.99) & (x[0] < 0.01))


def bump(x, middle):
    return height * np.cos(np.pi * np.clip(x - middle, -half, half) / (2 * half)) ** 2


def shaped(p):
    x, y, z = p.T
    top, bottom = bump(x, 1.0), 0.3 - bump(x, -0.8)
    z = np.where(z < 2.5, -0.5 + (top + 0.5) * z / 2, bottom + (0.8 - bottom) * (z - 3) / 2)
    return np.stack([x, y, z], axis=1)


mesh = move_nodes(create_submesh(whole, 3, np.union1d(catch, clip))[0], shaped)
spaces = Spaces.petrov_galerkin(mesh)
u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
mu, lame = 750.0, 1500.0  # MPa, a polymer
F = ufl.Identity(3) + ufl.grad(u)
J, F_T = ufl.det(F), ufl.inv(F).T
stress = mu * (F - F_T) + lame * ufl.ln(J) * F_T  # first Piola-Kirchhoff
residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})

pushed = fem.Constant(mesh, 0.0)
held = [prescribe(spaces.trial, i, lambda x: np.isclose(x[2], -0.5)) for i in range(3)]
held += [prescribe(spaces.trial, i, lambda x: np.isclose(x[0], -4.0)) for i in (1, 2)]
held.append(prescribe(spaces.trial, 0, lambda x: np.isclose(x[0], -4.0), pushed))


def head(x):
    return np.isclose(x[2], 0.3 - bump(x[0], -0.8)) & (np.abs(x[0] + 0.8) < 0.81)


def top(x):
    return np.isclose(x[2], bump(x[0], 1.0)) & (x[0] > -0.01)


under = fem.locate_dofs_topological(spaces.trial, 2, locate_entities_boundary(mesh, 2, head))
pair = ContactPair(under, DeformableSurface(top), friction=friction)
problem = ContactProblem.of_residual(residual, u, held, pair)


def push(start, end, share):
    pushed.value = (1 - share) * start + share * end


states, places = [problem.undeformed], np.linspace(1.1, 2.5, 15)  # mm; the first touches nothing
for ends in zip([0.0, *places[:-1]], places, strict=True):
    states.append(problem.step(states[-1], partial(push, *ends)))
forces = np.array([state.pairs[0].force for state in states[1:]])

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
u.x.array[:] = states[1 + int(forces[:, 2].argmax())].displacement.array_r
draw(mesh, (stress * F.T / J)[0, 0], u, axes=left, view=(12, -75), label="stress along x [MPa]")
right.plot(places, -forces[:, 0], label="against the push")
right.plot(places, forces[:, 2], label="upwards")
right.set(xlabel="way of the slide [mm]", ylabel="force on the clip [N]")
right.legend()
if mesh.comm.rank == 0:
    figure.savefig("snap_fit.png", dpi=150)
    print(f"{-forces[:, 0].min():.2f} N to push in, {forces[:, 0].max():.2f} N forwards behind it")
