from mpi4py import MPI

import gmsh
import numpy as np
from matplotlib.figure import Figure

from pw_elements import Body, Material, Reduction, Spaces, as_function, assemble_matrix
from pw_elements import assemble_vector, boundary_measure, draw, prescribe, reactions, solve
from pw_elements.meshes import from_gmsh
from pw_elements import forces_along

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
part = occ.cut([(2, occ.addRectangle(-40, -20, 0, 80, 40))], [(2, occ.addDisk(0, 0, 0, 4, 4))])[0]
occ.synchronize()
gmsh.model.addPhysicalGroup(2, [tag for _, tag in part], 1)
gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 50)
gmsh.option.setNumber("Mesh.MeshSizeMax", 4)
gmsh.model.mesh.generate(2)
gmsh.model.mesh.setOrder(2)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model, dim=2)
gmsh.finalize()

body = Body(Spaces.petrov_galerkin(mesh), Material(210e3, 0.3), "plane stress", thickness=2)
U = body.spaces.trial
left, right = (lambda x: np.isclose(x[0], -40)), (lambda x: np.isclose(x[0], 40))
K = assemble_matrix(body.stiffness())
f = assemble_vector(body.surface_load((100, 0), boundary_measure(mesh, right)))
a = solve(K, f, Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)]))
held = forces_along(U, reactions(K, a, f), left)
figure = Figure(figsize=(9, 3), layout="constrained")
axes, picture = figure.subplots(1, 2)
draw(mesh, body.stress(as_function(U, a))[0, 0], axes=picture, label="stress along x [MPa]")
if MPI.COMM_WORLD.rank == 0:
    axes.plot(held.position[:, 1], held.force, "o-", label=["along x", "along y"])
    axes.set(xlabel="y [mm]", ylabel="reaction at a node [N]")
    axes.legend()
    figure.savefig("hole.png")
