"""A bracket, bolted to a plate and pulled at its eye: where does it lift off?

Tetrahedra, a rigid plane, and friction, which alone holds the bracket.
"""

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np

from pw_elements import (
    Body, Material, Reduction, Spaces, as_function, assemble_matrix, assemble_vector,
    boundary_measure, draw,
)
from pw_elements.contact import OPEN, ContactPair, Plane, plot, solve_contact
from pw_elements.meshes import from_gmsh

size = 5.0  # mm, of the elements
bolt, pull = 8e3, 500.0  # N

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
foot, wall = (3, occ.addBox(0, 0, 0, 60, 40, 8)), (3, occ.addBox(0, 0, 0, 8, 40, 60))
corners = [occ.addPoint(8, 17, 8), occ.addPoint(30, 17, 8), occ.addPoint(8, 17, 40)]
lines = [occ.addLine(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
rib = occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))], 0, 6, 0)
shape = occ.fuse([foot], [wall, *[part for part in rib if part[0] == 3]])[0]
hole, head = occ.addCylinder(45, 20, 0, 0, 0, 8, 4.5), occ.addCircle(45, 20, 8, 9)
eye = occ.addCylinder(0, 20, 50, 8, 0, 0, 4)
shape = occ.cut(shape, [(3, hole), (3, eye)])[0]
shape = occ.fragment(shape, [(1, head)])[0]
occ.synchronize()
gmsh.model.addPhysicalGroup(3, [tag for dim, tag in shape if dim == 3], 1)
gmsh.option.setNumber("Mesh.MeshSizeMax", size)
gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 12)
gmsh.model.mesh.generate(3)
gmsh.model.mesh.setOrder(2)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

bracket = Body(Spaces.petrov_galerkin(mesh), Material(70e3, 0.33), "solid")
U = bracket.spaces.trial
K = assemble_matrix(bracket.stiffness())


def under_the_head(x):
    return np.isclose(x[2], 8) & (np.hypot(x[0] - 45, x[1] - 20) < 9 + 1e-6)


def in_the_eye(x):
    return np.isclose(np.hypot(x[1] - 20, x[2] - 50), 4)


head_load = (0, 0, -bolt / (np.pi * (9**2 - 4.5**2)))
tightened = assemble_vector(
    bracket.surface_load(head_load, boundary_measure(mesh, under_the_head))
)
eye_load = (pull / (np.pi * 8 * 8), 0, 0)
pulled = assemble_vector(bracket.surface_load(eye_load, boundary_measure(mesh, in_the_eye)))
plate = ContactPair(lambda x: np.isclose(x[2], 0), Plane((0, 0, 0), (0, 0, 1)), friction=0.2)
free = Reduction.dirichlet(U, [])  # friction alone holds it
state = solve_contact(K, [tightened, tightened + pulled], free, plate, U)[-1]
u = as_function(U, state.displacement)
foot = state.pairs[0]
closed = 100 * np.mean(foot.status != OPEN)

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
draw(mesh, bracket.von_mises(u), u, scale=30, axes=left, view=(52, -40), limits=(0, 100),
     label="von Mises stress [MPa]")
plot(state, bracket, axes=right, unit="MPa").set(xlabel="x [mm]", ylabel="y [mm]")
if mesh.comm.rank == 0:
    figure.savefig("bracket.png", dpi=150)
    print(f"{closed:.0f} % of the foot's nodes touch; the plate carries {foot.force[2]:.0f} N")
