"""Two gears' teeth in contact at the pitch point: two bodies whose meshes do not match.

Involute teeth, module 4 mm, 20 of them. The left rim is held, the right one turned a little; the
torque is the moment of the contact forces.
"""

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np
from dolfinx import fem
from gears_mesh import FLANKS, RIMS, mesh_gears, pitch

from pw_elements import Body, Material, Reduction, Spaces, as_function, assemble_matrix, draw
from pw_elements.contact import ContactPair, DeformableSurface, solve_contact
from pw_elements.meshes import from_gmsh

size = 0.25  # mm, of the elements on the flanks
turn = 4e-4  # radians

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
if MPI.COMM_WORLD.rank == 0:
    mesh_gears(size)
mesh, _, facets, _ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()
body = Body(Spaces.petrov_galerkin(mesh), Material(210e3, 0.3), "plane strain")
U = body.spaces.trial
turned = fem.Function(U)
turned.interpolate(lambda x: turn * np.array([-x[1], x[0] - 2 * pitch]) * (x[0] > pitch))
held = Reduction.dirichlet(U, [
    fem.dirichletbc(turned, fem.locate_dofs_topological(U, 1, facets.find(part))) for part in RIMS
])
K = assemble_matrix(body.stiffness())
own = fem.locate_dofs_topological(U, 1, facets.find(FLANKS[0]))
pair = ContactPair(own, DeformableSurface(facets.find(FLANKS[1])), friction=0.1)
(state,) = solve_contact(K, K.createVecLeft(), held, pair, U)

u = as_function(U, state.displacement)
x, force = state.pairs[0].position, state.pairs[0].force_vector
torque = np.sum(x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]) / 1e3

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
for ax in (left, right):
    label = "von Mises stress [MPa]" if ax is right else ""
    draw(mesh, body.von_mises(u), u, axes=ax, limits=(0, 250), edges=ax is right, label=label)
    ax.set(xlabel="x [mm]", ylabel="y [mm]")
right.set(xlim=(pitch - 3, pitch + 3), ylim=(-3, 3))
if mesh.comm.rank == 0:
    figure.savefig("gears.png", dpi=150)
    print(f"torque on the left gear: {-torque:.1f} N m per mm of width")
