"""A rubber roller, pressed on a rigid road and rolled: large strains, sliding and friction.

Its hub is moved down, then turned, and moved along the road by less than it turns: the roller
drives. The hub's way is a function of the share of an increment, for what turns goes along no
straight line. Only the part of the roller is meshed that comes near the road.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem

from pw_elements import Spaces, SurfaceNodes, draw
from pw_elements.contact import OPEN, ContactPair, ContactProblem, Plane
from pw_elements.meshes import move_nodes, triangles

cells = 8  # through the rubber, whose radii are 0.5 and 1
mu, lame, friction = 1.0, 4.0, 0.5  # MPa
depth, angle, slip, steps = 0.12, 0.6, 0.03, 6  # of the hub's way

mesh = triangles(MPI.COMM_WORLD, (-2.6, 0.5), (0.3, 1.0), (8 * cells, cells), "crossed")
mesh = move_nodes(mesh, lambda p: p[:, 1:2] * np.stack([np.cos(p[:, 0]), np.sin(p[:, 0])], axis=1))
spaces = Spaces.petrov_galerkin(mesh)
u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
F = ufl.Identity(2) + ufl.grad(u)
J, F_T = ufl.det(F), ufl.inv(F).T
stress = mu * (F - F_T) + lame * ufl.ln(J) * F_T  # first Piola-Kirchhoff
residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})


def tread(x):
    return np.hypot(x[0], x[1]) > 0.99


hub = fem.Function(spaces.trial)
rim = fem.locate_dofs_geometrical(spaces.trial, lambda x: np.hypot(x[0], x[1]) < 0.5 + 1e-9)
road = ContactPair(tread, Plane((0, -1), (0, 1)), friction=friction)
problem = ContactProblem.of_residual(residual, u, fem.dirichletbc(hub, rim), road)


def placed(down, turned):
    c, s = np.cos(turned), np.sin(turned)
    along = (1 - slip) * (1 - depth / 2) * turned
    hub.interpolate(
        lambda x: np.stack([(c - 1) * x[0] + s * x[1] + along, (c - 1) * x[1] - s * x[0] - down])
    )


state = problem.step(problem.undeformed, lambda share: placed(share * depth, 0.0))
for k in range(steps):
    state = problem.step(state, lambda share, k=k: placed(depth, (k + share) / steps * angle))

(pair,) = state.pairs
scalars = Spaces.petrov_galerkin(mesh, 0)
areas = SurfaceNodes.from_scalar_spaces(scalars, tread, SurfaceNodes.area_stretch(u))
pressure, closed = areas.pressure(pair.force_normal), pair.status != OPEN
x = (pair.position + pair.displacement)[closed, 0]

figure, (body, line) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
cauchy = stress * F.T / J
draw(mesh, -cauchy[1, 1], u, axes=body, label="vertical pressure [MPa]", colours="magma",
     limits=(-0.2, 1.2))
body.axhline(-1, color="0.4")
body.set(xlabel="x [mm]")
line.plot(x, pressure[closed], "o-", ms=3)
line.set(xlabel="x [mm]", ylabel="true pressure on the road [MPa]", ylim=(0, None))
if mesh.comm.rank == 0:
    figure.savefig("rubber_roller.png", dpi=150)
    print(f"width {np.ptp(x):.3f} mm, pressure {pressure[closed].max():.3f} MPa, pressed by "
          f"{pair.force[1]:.3f} and driving with {pair.force[0]:.3f} N/mm")
