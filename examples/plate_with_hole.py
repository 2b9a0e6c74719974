"""A plate with a hole, pulled: the stress at the hole, and what the cut below it carries.

A quarter of a steel plate in plane stress; by symmetry its cuts only slide. Far from the hole the
stress is 100 MPa, at its edge it is three times that in an infinite plate (Kirsch), and a little
more here, for the plate is finite. The forces on the cut are the supports' reactions: with the
piecewise-linear weights they are as smooth as the stress.
"""

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np

from pw_elements import (
    Body, Material, Reduction, Spaces, as_function, assemble_matrix, assemble_vector,
    boundary_measure, draw, nodal_flux, prescribe, reactions, solve,
)
from pw_elements.meshes import from_gmsh

size = 6.0  # mm, of the elements; a sixth of it at the hole
hole, half_width, half_length = 10.0, 50.0, 80.0  # mm
thickness, pull = 5.0, 100.0  # mm, MPa

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
quarter = occ.cut([(2, occ.addRectangle(0, 0, 0, half_width, half_length))],
                  [(2, occ.addDisk(0, 0, 0, hole, hole))])[0]
occ.synchronize()
gmsh.model.addPhysicalGroup(2, [tag for _, tag in quarter], 1)
gmsh.model.mesh.setSize(gmsh.model.getEntities(0), size)
ends = gmsh.model.getEntitiesInBoundingBox(-1, -1, -1, hole + 1, hole + 1, 1, 0)
gmsh.model.mesh.setSize(ends, size / 6)
gmsh.model.mesh.generate(2)
gmsh.model.mesh.setOrder(2)  # mid-side nodes on the circle
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

steel = Body(Spaces.petrov_galerkin(mesh), Material(210e3, 0.3), "plane stress", thickness)
U = steel.spaces.trial
below, left = (lambda x: np.isclose(x[1], 0)), (lambda x: np.isclose(x[0], 0))
K = assemble_matrix(steel.stiffness())
above = boundary_measure(mesh, lambda x: np.isclose(x[1], half_length))
f = assemble_vector(steel.surface_load((0, pull), above))
held = Reduction.dirichlet(U, [prescribe(U, 1, below), prescribe(U, 0, left)])
a = solve(K, f, held)
u = as_function(U, a, "displacement")
cut = nodal_flux(steel.spaces, reactions(K, a, f), below, depth=thickness)
stress = -cut.flux[:, 1]

figure, (left_axes, right_axes) = plt.subplots(1, 2, figsize=(9, 5), layout="constrained")
draw(mesh, steel.von_mises(u), u, scale=100, axes=left_axes, label="von Mises stress [MPa]")
left_axes.set(xlabel="x [mm]", ylabel="y [mm]", title="Displacements × 100")
right_axes.fill_between(cut.surface.position[:, 0], stress, color="#cfe3f5")
right_axes.plot(cut.surface.position[:, 0], stress, "o-", color="#0072B2", ms=4)
right_axes.set(xlabel="x [mm]", ylabel="stress on the cut [MPa]", ylim=0, title="Reaction / area")
if MPI.COMM_WORLD.rank == 0:
    figure.savefig("plate_with_hole.png", dpi=150)
    print(f"stress at the hole: {stress[0]:.0f} MPa, {stress[0] / pull:.2f} times the pull")
