"""A steel roller pressed on a polyamide dome and pushed sideways, with friction.

The pressure is even. Shear is jagged where nodes stick, with any element: each node keeps what it
had when it came to stick, and the contact grew by increments. The tutorial takes a like problem
apart line by line.
"""

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np
from dolfinx import fem
from dolfinx.mesh import locate_entities_boundary

from pw_elements import (
    Body, Material, Reduction, Spaces, as_function, assemble_matrix, draw, prescribe,
)
from pw_elements.contact import ContactPair, Motion, Sphere, plot, solve_contact
from pw_elements.meshes import from_gmsh

size, zone = 0.08, 1.6  # mm, of the elements near the contact, and half its width at most
dome, roller_radius, press, push = 20.0, 30.0, 70.0, 14.0  # mm, N/mm

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ, field = gmsh.model.occ, gmsh.model.mesh.field
disk, lower = occ.addDisk(0, 0, 0, dome, dome), occ.addRectangle(-dome, -dome, 0, 2 * dome, dome)
half = occ.cut([(2, disk)], [(2, lower)])[0]
occ.synchronize()
gmsh.model.addPhysicalGroup(2, [half[0][1]], 1)
sizes = field.add("MathEval")
field.setString(sizes, "F", f"Max({size}, 0.2 * (Sqrt(x*x + (y-{dome})*(y-{dome})) - {zone}))")
field.setAsBackgroundMesh(sizes)
gmsh.model.mesh.generate(2)
gmsh.model.mesh.setOrder(2)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

body = Body(Spaces.petrov_galerkin(mesh), Material(3000.0, 0.4), "plane strain")
U = body.spaces.trial
K = assemble_matrix(body.stiffness())
held = Reduction.dirichlet(U, [prescribe(U, i, lambda x: np.isclose(x[1], 0)) for i in (0, 1)])


def near_the_top(x):
    return np.isclose(np.hypot(x[0], x[1]), dome) & (np.abs(x[0]) < zone) & (x[1] > 0)


roller = Sphere((0, dome + roller_radius), roller_radius)
motions = [Motion((0, None), force=(0, -press * s)) for s in np.linspace(0, 1, 13)[1:]]
motions += [Motion((None, None), force=(push * s, -press)) for s in (0.5, 1.0)]
facets = locate_entities_boundary(mesh, 1, near_the_top)
top = fem.locate_dofs_topological(U, 1, facets)  # the nodes of whole sides
pair = ContactPair(top, roller, friction=0.3, motions=motions)
state = solve_contact(K, [K.createVecLeft()] * len(motions), held, pair, U)[-1]
u = as_function(U, state.displacement)

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
draw(mesh, body.von_mises(u), u, axes=left, label="von Mises stress [MPa]", edges=False)
left.set(xlim=(-6, 6), ylim=(14.5, 22.5), xlabel="x [mm]", ylabel="y [mm]")
centre = np.add((0, dome + roller_radius), state.pairs[0].translation)
left.add_patch(plt.Circle(centre, roller_radius, color="0.6", zorder=0))
plot(state, body, axes=right, along=0, unit="MPa").set(xlabel="x [mm]")
if MPI.COMM_WORLD.rank == 0:
    figure.savefig("roller_on_dome.png", dpi=150)
