from mpi4py import MPI

import numpy as np
from dolfinx import fem

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix
from pw_elements.contact import SLIP, STICK, ContactPair, Motion, Sphere, plot, solve_contact
from pw_elements.meshes import from_gmsh

STEEL, FIBRE, BASE, TOP = 1, 2, 3, 4
mesh, cell_tags, facet_tags = from_gmsh(MPI.COMM_WORLD, "gasket.msh", dim=2)
materials = {STEEL: Material(210e3, 0.3), FIBRE: Material(600.0, 0.4)}
both = Material.by_tag(mesh, cell_tags, materials)
body = Body(Spaces.petrov_galerkin(mesh), both, "plane strain")
U = body.spaces.trial
K = assemble_matrix(body.stiffness())
base = fem.locate_dofs_topological(U, 1, facet_tags.find(BASE))
held = Reduction.dirichlet(U, fem.dirichletbc(np.zeros(2), base, U))
top = fem.locate_dofs_topological(U, 1, facet_tags.find(TOP))
press = [Motion((0, None), force=(0, -80 * s)) for s in (0.25, 0.5, 0.75, 1)]
push = [Motion((None, None), force=(16 * s, -80)) for s in (0.5, 1)]
cylinder = ContactPair(top, Sphere((0, 31), 25), 0.3, press + push)
states = solve_contact(K, [K.createVecLeft()] * len(press + push), held, cylinder, U)
contact = states[-1].pairs[0]
axes = plot(states[-1], body, along=0)
axes.set(xlim=(-3, 3), xlabel="x [mm]", ylabel="traction [MPa]")
if MPI.COMM_WORLD.rank == 0:
    axes.figure.savefig("gasket.png")
    print("the cylinder moves by", contact.translation, "mm")
    print(np.sum(contact.status == STICK), "nodes stick,", np.sum(contact.status == SLIP), "slip")
