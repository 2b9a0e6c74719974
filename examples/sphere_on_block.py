"""A rigid sphere on an elastic block: Hertz's stresses below the surface, in space.

A quarter of the block, seen from the cut planes: the greatest shear is not at the surface, but half
a contact radius below it.
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
from pw_elements.contact import ContactFields, ContactPair, Motion, Sphere, solve_contact
from pw_elements.meshes import from_gmsh

size, side = 0.15, 4.0  # over the radius of the contact, which is 1 mm
E, nu, radius = 70e3, 0.3, 50.0  # MPa, mm
force = 4 * E / (1 - nu**2) / (3 * radius)  # of Hertz for a contact of radius 1
peak = 3 * force / (2 * np.pi)

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
box = gmsh.model.occ.addBox(0, 0, -side, side, side, side)
gmsh.model.occ.synchronize()
gmsh.model.addPhysicalGroup(3, [box], 1)
sizes = gmsh.model.mesh.field.add("MathEval")
gmsh.model.mesh.field.setString(sizes, "F", f"Max({size}, 0.4 * (Sqrt(x*x + y*y + z*z) - 0.9))")
gmsh.model.mesh.field.setAsBackgroundMesh(sizes)
gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
gmsh.model.mesh.generate(3)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

block = Body(Spaces.petrov_galerkin(mesh), Material(E, nu), "solid")
U = block.spaces.trial
K = assemble_matrix(block.stiffness())
cuts = [prescribe(U, i, lambda x, i=i: np.isclose(x[i], 0)) for i in (0, 1)]
below = prescribe(U, 2, lambda x: np.isclose(x[2], -side))
press = Motion((0, 0, None), force=(0, 0, -force / 4))
near = locate_entities_boundary(
    mesh, 2, lambda x: np.isclose(x[2], 0) & (np.hypot(x[0], x[1]) < 1.5)
)
nodes = fem.locate_dofs_topological(U, 2, near)  # of whole facets
pair = ContactPair(nodes, Sphere((0, 0, radius), radius), motions=press)
(state,) = solve_contact(K, K.createVecLeft(), Reduction.dirichlet(U, [*cuts, below]), pair, U)
u = as_function(U, state.displacement)
fields = ContactFields.from_state(state, block)
(surface,) = fields.surfaces
pressure = surface.pressure(state.pairs[0].force_normal)

figure = plt.figure(figsize=(10.5, 4.4), layout="constrained")
left, right = figure.subplots(1, 2, width_ratios=(3, 2))
draw(mesh, block.von_mises(u), u, axes=left, view=(25, -135), colours="inferno",
     label="von Mises stress [MPa]")
r = np.hypot(*surface.position[:, :2].T)
exact = np.linspace(0, 1, 200)
right.plot(r, pressure, ".", color="#0072B2", label="nodes")
right.plot(exact, peak * np.sqrt(1 - exact**2), "k", lw=1, label="Hertz, half space")
right.set(xlabel="distance from the axis [mm]", ylabel="pressure [MPa]", xlim=(0, 1.4))
right.legend(frameon=False)
if mesh.comm.rank == 0:
    figure.savefig("sphere_on_block.png", dpi=150)
    print(f"greatest pressure {np.nanmax(pressure):.0f} MPa, Hertz {peak:.0f} MPa")
