from mpi4py import MPI

import gmsh
import numpy as np

from pw_elements import Body, Material, Reduction, Spaces, as_function, assemble_matrix
from pw_elements import assemble_vector, boundary_measure, draw
from pw_elements.contact import ContactPair, Plane, plot, solve_contact
from pw_elements.meshes import from_gmsh

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
foot, leg = occ.addBox(0, 0, 0, 40, 20, 5), occ.addBox(0, 0, 0, 5, 20, 30)
bracket = occ.fuse([(3, foot)], [(3, leg)])[0]
occ.synchronize()
gmsh.model.addPhysicalGroup(3, [tag for _, tag in bracket], 1)
gmsh.option.setNumber("Mesh.MeshSizeMax", 5)
gmsh.model.mesh.generate(3)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

body = Body(Spaces.petrov_galerkin(mesh), Material(70e3, 0.33), "solid")
U = body.spaces.trial
K = assemble_matrix(body.stiffness())
on_leg = boundary_measure(mesh, lambda x: np.isclose(x[2], 30))
on_foot = boundary_measure(mesh, lambda x: np.isclose(x[2], 5))
f = assemble_vector(body.surface_load((0, 0, -5), on_leg))
f += assemble_vector(body.surface_load((0, 0, -1), on_foot))
ground = ContactPair(lambda x: np.isclose(x[2], 0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
(state,) = solve_contact(K, f, Reduction.dirichlet(U, []), ground, U)
u = as_function(U, state.displacement, "displacement")
axes, face = draw(mesh, body.von_mises(u), u, scale=2000, label="MPa"), plot(state, body)
if MPI.COMM_WORLD.rank == 0:
    axes.figure.savefig("bracket.png")
    face.figure.savefig("ground.png")
    print("the ground carries", state.pairs[0].force, "N")
