"""A wheel on a rubber track, driven by a torque until it spins: a rigid surface that turns.

The load on the wheel and the torque are given, the height of the hub and the angle are found. When
friction has no more to give, the torque cannot grow: from there on the angle is prescribed, and the
torque found is the coefficient of friction times the sum of normal forces times the radius.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem

from pw_elements import Spaces, draw, prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, ContactProblem, Motion, Sphere
from pw_elements.meshes import triangles

cells = 8  # over the height of the track
R, friction, load = 1.0, 0.4, 0.8  # mm, and N/mm over a shear modulus of 1 MPa
hub, limit = (0.0, R), friction * load * R

mesh = triangles(MPI.COMM_WORLD, (-1.5, -1), (1.5, 0), (3 * cells, cells), "crossed")
spaces = Spaces.petrov_galerkin(mesh)
u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
F = ufl.Identity(2) + ufl.grad(u)
J, F_T = ufl.det(F), ufl.inv(F).T
stress = F - F_T + 4 * ufl.ln(J) * F_T  # first Piola-Kirchhoff
residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})
held = [prescribe(spaces.trial, i, lambda x: np.isclose(x[1], -1)) for i in (0, 1)]
wheel = ContactPair(lambda x: np.isclose(x[1], 0), Sphere(hub, R), friction, pivot=hub)
problem = ContactProblem.of_residual(residual, u, held, wheel)

down = (0.0, -load)
state = problem.step(problem.undeformed, motions=Motion((0, -0.1)))
state = problem.step(state, motions=Motion((0, None), down))
states = [state]
for torque in np.linspace(0.15, 0.9, 6) * limit:  # clockwise
    motion = Motion((0, None), down, rotation=None, torque=-torque)
    states.append(problem.step(states[-1], motions=motion))
last = float(states[-1].pairs[0].rotation)
for further in (0.05, 0.1, 0.15):
    motion = Motion((0, None), down, rotation=last - further)
    states.append(problem.step(states[-1], motions=motion))

pairs = [state.pairs[0] for state in states]
angles = -np.array([float(pair.rotation) for pair in pairs])
torques = -np.array([float(pair.torque) for pair in pairs])
limits = np.array([friction * R * pair.force_normal.sum() for pair in pairs])
sticking = [np.mean(pair.status[pair.status != OPEN] == STICK) for pair in pairs]

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
draw(mesh, (stress * F.T / J)[0, 1], u, axes=left, label="shear stress [MPa]")
pair, circle = pairs[-1], np.linspace(0, 2 * np.pi, 200)
centre = hub + pair.translation
spoke = np.array([[0, 0], [np.sin(angles[-1]), np.cos(angles[-1])]]) * R + centre
left.plot(*(centre[:, None] + R * np.stack([np.cos(circle), np.sin(circle)])), color="0.3")
left.plot(*spoke.T, "o-", color="0.3", ms=3)
feet, forces = pair.position + pair.displacement, -pair.force_vector  # on the wheel
left.quiver(*feet.T, *forces.T, angles="xy", scale_units="xy", scale=0.2, width=0.004)
left.set(xlabel="x [mm]", ylabel="y [mm]", xlim=(-1.6, 1.6), ylim=(-1.05, 1.9), aspect="equal")
right.plot(angles, torques / limits, "o-", label="torque over its limit")
right.plot(angles, sticking, "s--", label="share that sticks")
right.axhline(1, color="0.6", lw=1)
right.set(xlabel="angle of the wheel [rad]", ylim=(-0.05, 1.25))
right.legend(loc="upper center", ncols=2)
if mesh.comm.rank == 0:
    figure.savefig("driven_wheel.png", dpi=150)
    print(f"angle {angles[-1]:.3f}, {R - centre[1]:.3f} mm deep, torque {torques[-1]:.6f} Nmm/mm; "
          f"friction's coefficient times normal forces times radius {limits[-1]:.6f}")
