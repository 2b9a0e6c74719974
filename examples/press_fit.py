"""A hub shrunk on a shaft that is 40 µm too thick: pressure in the bore, stress round the holes.

A quarter of the hub; the shaft is rigid. Without holes the pressure would be even (Lamé's). Between
the holes the hub is stiffer and presses harder.
"""

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np

from pw_elements import (
    Body, Material, Reduction, Spaces, as_function, assemble_matrix, draw, prescribe,
)
from pw_elements.contact import ContactFields, ContactPair, Sphere, solve_contact
from pw_elements.meshes import from_gmsh

size = 1.0  # mm, of the elements
bore, rim, holes, hole, oversize = 20.0, 45.0, 31.0, 6.0, 0.02  # mm, radii

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
hub = occ.intersect([(2, occ.addDisk(0, 0, 0, rim, rim))], [(2, occ.addRectangle(0, 0, 0, 50, 50))])
angles = np.radians([0, 45, 90])
cuts = [(2, occ.addDisk(holes * np.cos(t), holes * np.sin(t), 0, hole, hole)) for t in angles]
hub = occ.cut(hub[0], [(2, occ.addDisk(0, 0, 0, bore, bore)), *cuts])
occ.synchronize()
gmsh.model.addPhysicalGroup(2, [tag for _, tag in hub[0]], 1)
gmsh.option.setNumber("Mesh.MeshSizeMax", size)
gmsh.model.mesh.generate(2)
gmsh.model.mesh.setOrder(2)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

body = Body(Spaces.petrov_galerkin(mesh), Material(210e3, 0.3), "plane strain")
U = body.spaces.trial
K = assemble_matrix(body.stiffness())
cuts = [prescribe(U, i, lambda x, i=i: np.isclose(x[i], 0)) for i in (0, 1)]
held = Reduction.dirichlet(U, cuts)
shaft = Sphere((0, 0), bore + oversize)
pair = ContactPair(lambda x: np.isclose(np.hypot(x[0], x[1]), bore), shaft, interference=True)
(state,) = solve_contact(K, K.createVecLeft(), held, pair, U)
u = as_function(U, state.displacement)
(surface,) = ContactFields.from_state(state, body).surfaces
pressure = surface.pressure(state.pairs[0].force_normal)
x, y = state.pairs[0].position.T
lame = 210e3 / (1 - 0.3**2) * oversize / bore  # of a hub without holes, over its stiffness
lame /= (rim**2 + bore**2) / (rim**2 - bore**2) + 0.3 / (1 - 0.3)

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
draw(mesh, body.von_mises(u), u, scale=100, axes=left, label="von Mises stress [MPa]")
left.set(xlabel="x [mm]", ylabel="y [mm]", title="Displacements × 100")
left.add_patch(plt.Circle((0, 0), bore + 100 * oversize, color="0.6", zorder=0))
right.plot(np.degrees(np.arctan2(y, x)), pressure, ".-", label="with holes")
right.axhline(lame, color="k", ls="--", label="without holes (Lamé)")
right.set(xlabel="angle [°]", ylabel="pressure in the bore [MPa]", ylim=(0, 150))
right.set_xticks(np.linspace(0, 90, 7))
right.legend(frameon=False, ncols=2, loc="upper center")
if MPI.COMM_WORLD.rank == 0:
    figure.savefig("press_fit.png", dpi=150)
    print(f"pressure {pressure.min():.0f} to {pressure.max():.0f} MPa")
    print(f"without holes {lame:.0f} MPa")
