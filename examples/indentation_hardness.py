"""The hardness of a metal: a rigid ball leaves a dent in an elastic-plastic block.

Plastic strains are history functions at the material points, with expressions of their new values.
The mean pressure below the ball approaches three times the yield stress, and the dent remains when
the ball is lifted. A pressure field prevents locking, because plastic flow keeps volumes. The small
tolerance of the condition for flow makes the tangent plastic from the start of a step.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem

from pw_elements import Spaces, assemble_vector, draw, history_space, prescribe, split
from pw_elements.contact import OPEN, ContactPair, ContactProblem, Motion, Sphere
from pw_elements.meshes import move_nodes, quadrilaterals

cells = 24  # along each side of the block, smaller ones below the ball
E, nu, limit, hardening = 210e3, 0.3, 300.0, 300.0  # MPa
radius, size, depths = 5.0, 10.0, (*np.linspace(0.01, 0.08, 8), 0.078, 0.075, 0.07)  # mm
shear, bulk = E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu))
square = quadrilaterals(MPI.COMM_WORLD, (0, -1), (1, 0), (cells, cells))
mesh = move_nodes(square, lambda x: size * np.sinh(4 * x) / np.sinh(4))
spaces = Spaces.hybrid(mesh)
w, r = fem.Function(spaces.trial), ufl.SpatialCoordinate(mesh)[0]
(u, p), (v, q) = ufl.split(w), ufl.split(ufl.TestFunction(spaces.test))
tensors, dx = history_space(spaces, (3, 3))
inverse_C_p, strain = fem.Function(tensors), fem.Function(history_space(spaces)[0])
inverse_C_p.x.array[:] = np.tile(np.eye(3).ravel(), len(inverse_C_p.x.array) // 9)


def gradient(a):
    g = ufl.grad(a)
    return ufl.as_tensor([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, a[0] / r]])


one = ufl.Identity(3)
F = one + gradient(u)
J = ufl.det(F)
isochoric = J ** (-1 / 3) * F
elastic = isochoric * inverse_C_p * isochoric.T  # if nothing flows
mean, trial = ufl.tr(elastic) / 3, shear * ufl.dev(elastic)
norm = ufl.sqrt(ufl.inner(trial, trial) + 1e-20)
excess = norm - np.sqrt(2 / 3) * (limit + hardening * strain)
flow = ufl.conditional(excess > -1e-8 * limit, excess / (2 * shear * mean + 2 / 3 * hardening), 0)
stress = trial * (1 - 2 * shear * mean * flow / norm)
piola = (stress - p * J * one) * ufl.inv(F).T
work = ufl.inner(piola, gradient(v)) - q * (J - 1 + p / bulk)
new_C_p = ufl.inv(isochoric) * (stress / shear + mean * one) * ufl.inv(isochoric).T
history = {inverse_C_p: new_C_p, strain: strain + np.sqrt(2 / 3) * flow}

held = [prescribe(spaces.trial, i, lambda x, i=i: np.isclose(x[i], -size * i)) for i in (0, 1)]
ball = ContactPair(lambda x: np.isclose(x[1], 0), Sphere((0, radius), radius))
problem = ContactProblem.of_residual(2 * np.pi * r * work * dx, w, held, ball, history=history)
state, forces, pressures = problem.undeformed, [0.0], []
for depth in depths:
    state = problem.step(state, motions=Motion((0, -depth)))
    (pair,) = state.pairs
    forces.append(-pair.force[1] / 1e3)
    x, count = np.sort((pair.position + pair.displacement)[:, 0]), np.sum(pair.status != OPEN)
    pressures.append(-pair.force[1] / (np.pi * x[max(count, 1) - 1 :][:2].mean() ** 2))

means = fem.functionspace(mesh, ("DG", 0))  # the strain's mean values in cells
mean_strain, cell = fem.Function(means), ufl.TestFunction(means)
integrals = [assemble_vector(f * cell * dx) for f in (strain, 1)]
mean_strain.x.petsc_vec.pointwiseDivide(*integrals)
mean_strain.x.scatter_forward()
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
draw(mesh, mean_strain, split(spaces.trial, w.x.petsc_vec)[0], axes=left, label="plastic strain")
left.set(xlim=(0, 2.5), ylim=(-2, 0.2), xlabel="r [mm]", ylabel="z [mm]")
right.plot([0, *depths], forces, "o-", markersize=3)
right.set(xlabel="depth of the ball [mm]", ylabel="force [kN]")
if mesh.comm.rank == 0:
    figure.savefig("indentation_hardness.png", dpi=150)
    print(f"mean pressure over the yield stress: {max(pressures) / limit:.2f}")
