"""A seal that relaxes: its contact force falls while the plates are held.

Viscoelastic rubber, incompressible and with one Maxwell branch. The stresses of branch and spring,
and the time at the start of each step, are history functions. The last one tells a substep how long
it is, so that an increment may be cut.
"""

from functools import partial

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem

from pw_elements import Spaces, assemble_vector, draw, history_space, prescribe, split
from pw_elements.contact import ContactPair, ContactProblem, Motion, Plane
from pw_elements.meshes import curved_mesh, triangles

cells = 10  # over the radius of the cord, which is 1 mm
slow, branch_modulus, tau = 1.0, 1.5, 20.0  # MPa, MPa, s
times = np.concatenate([np.linspace(0, 5, 11), 5 * 1.4 ** np.arange(1, 10)])  # s
squeezes = 0.3 * np.minimum(times / 5, 1)  # mm
square = triangles(MPI.COMM_WORLD, (0, 0), (1, 1), (cells, cells), "crossed")
mesh = curved_mesh(square, lambda x: x * np.sqrt(1 - x[:, [1, 0, 2]] ** 2 / 2))
spaces = Spaces.hybrid(mesh)
w = fem.Function(spaces.trial)
(u, p), (v, q) = ufl.split(w), ufl.split(ufl.TestFunction(spaces.test))
tensors, dx = history_space(spaces, (3, 3))
branch, spring = fem.Function(tensors), fem.Function(tensors)
time, start_time = fem.Constant(mesh, 0.0), fem.Function(history_space(spaces)[0])


def gradient(a):
    g = ufl.grad(a)
    return ufl.as_tensor([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, 0]])


def outside(x):
    return np.isclose(np.hypot(x[0], x[1]), 1) & (x[1] > 0.35)


def move_time(start, end, share):
    time.value = start + share * (end - start)


F = ufl.Identity(3) + gradient(u)
C, J = F.T * F, ufl.det(F)
duration = (time - start_time) / tau
new_spring = J ** (-2 / 3) * (ufl.Identity(3) - ufl.tr(C) / 3 * ufl.inv(C))
change = branch_modulus * (new_spring - spring)
new_branch = ufl.exp(-duration) * branch + ufl.exp(-duration / 2) * change
piola = F * (slow * new_spring + new_branch) - p * J * ufl.inv(F).T
residual = (ufl.inner(piola, gradient(v)) - q * (J - 1)) * dx

cuts = [prescribe(spaces.trial, i, lambda x, i=i: np.isclose(x[i], 0)) for i in (0, 1)]
plate = ContactPair(outside, Plane((0, 1), (0, -1)))
history = {branch: new_branch, spring: new_spring, start_time: time}
problem = ContactProblem.of_residual(residual, w, cuts, plate, history=history)
state, forces = problem.undeformed, [0.0]
for start, end, squeeze in zip(times[:-1], times[1:], squeezes[1:], strict=True):
    state = problem.step(state, partial(move_time, start, end), Motion((0, -squeeze)))
    forces.append(-2 * state.pairs[0].force[1])  # of both halves, N/mm

means = fem.functionspace(mesh, ("DG", 0))  # the pressure's mean values in cells
mean_pressure, cell = fem.Function(means), ufl.TestFunction(means)
integrals = [assemble_vector(f * cell * dx) for f in (-(piola * F.T / J)[1, 1], 1)]
mean_pressure.x.petsc_vec.pointwiseDivide(*integrals)
mean_pressure.x.scatter_forward()
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
moved, _ = split(spaces.trial, state)
draw(mesh, mean_pressure, moved, axes=left, label="vertical pressure [MPa]", colours="magma")
left.set(xlabel="x [mm]", ylabel="y [mm]")
right.plot(times, forces, "o-", markersize=3)
right.set(xlabel="time [s]", ylabel="force per length [N/mm]")
if mesh.comm.rank == 0:
    figure.savefig("relaxing_seal.png", dpi=150)
    print(f"largest force {max(forces):.2f} N/mm, after {times[-1]:.0f} s {forces[-1]:.2f} N/mm")
