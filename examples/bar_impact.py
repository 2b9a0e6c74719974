"""A steel bar hits a wall at 10 m/s: the wave runs up, comes back, and the bar flies off.

Explicit dynamics of a solid of revolution with the symmetric sibling and its lumped mass. The
wall's force is that of the theory of rods, rho c v A, until the wave is back after 2 L / c.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np

from pw_elements import (
    Body, Material, Sibling, Spaces, as_function, assemble_matrix, draw, lumped_mass,
    prescribe,
)
from pw_elements.contact import ContactPair, Plane, solve_impact
from pw_elements.meshes import quadrilaterals

cells = 3  # over the radius
radius, length, speed = 0.01, 0.1, 10.0  # m, m/s
E, nu, rho = 210e9, 0.3, 7850.0  # Pa, kg/m³
mesh = quadrilaterals(MPI.COMM_WORLD, (0, 0), (radius, length), (cells, 10 * cells))
bar = Body(Spaces.galerkin(mesh), Material(E, nu, rho), "axisymmetric")
U = bar.spaces.trial

sibling = Sibling.from_space(U)
K = sibling.matrix(assemble_matrix(bar.stiffness()))
M = lumped_mass(sibling.matrix(assemble_matrix(bar.mass())), U)
on_axis = sibling.dirichlet(prescribe(U, 0, lambda x: np.isclose(x[0], 0)))
thrown = K.createVecRight()
thrown.setArray(np.tile([0.0, -speed], thrown.getLocalSize() // 2))
thrown = sibling.coefficients(thrown)
wall = ContactPair(lambda x: np.isclose(x[1], 0), Plane((0, 0), (0, 1)))
c = np.sqrt(E / rho)
duration = 2.4 * length / c
history = solve_impact(K, M, on_axis, wall, U, duration, thrown, frames=8)
force = history.pairs[0].total_force[:, 1] / 1e3
expected = rho * c * speed * np.pi * radius**2 / 1e3

figure = plt.figure(figsize=(9, 7), layout="constrained")
rows = figure.subfigures(2, 1, height_ratios=(3, 2))
frames = zip(rows[0].subplots(1, 8), history.frames, history.frame_times, strict=True)
for ax, frame, time in frames:
    u = as_function(U, frame.displacement)
    pressure = -bar.stress(u)[1, 1] / 1e6
    draw(mesh, pressure, u, scale=20, axes=ax, edges=False, colours="coolwarm", limits=(-500, 500))
    ax.axhline(0, color="k", lw=3)
    ax.set_axis_off()
    ax.set(xlim=(0, 1.3 * radius), ylim=(-0.005, 0.115), title=f"{time * 1e6:.0f} µs")
ax = rows[1].subplots()
ax.plot(history.time[:-1] * 1e6, force, label="wall on bar")
back = 2e6 * length / c
ax.plot([0, 0, back, back], [0, expected, expected, 0], "k--", label="rod theory")
ax.set(xlabel="time [µs]", ylabel="force [kN]")
ax.legend(frameon=False)
if mesh.comm.rank == 0:
    figure.savefig("bar_impact.png", dpi=150)
    print(f"force {np.median(force[force > 0.2 * expected]):.1f} kN, of rods {expected:.1f} kN")
