"""Seepage under a dam with a sheet pile: potential, flow lines, and where the water goes.

Darcy's law in a bed of sand 10 m deep. The water stands 6 m higher on the left; the dam, the pile
and the rock below are tight. What seeps is read off the reactions of the prescribed heads.
"""

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np
import ufl

from pw_elements import (
    Reduction, Spaces, as_function, assemble_matrix, draw, nodal_flux, prescribe, reactions,
    solve,
)
from pw_elements.meshes import from_gmsh

size, permeability, head = 1.0, 1e-5, 6.0  # m, m/s, m
length, deep, dam, pile = 40.0, 10.0, 6.0, 5.0  # m; the dam is -dam < x < dam, the pile at x = dam

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
bed = [(2, occ.addRectangle(-length / 2, -deep, 0, length, deep))]
slot = [(2, occ.addRectangle(dam - 0.1, -pile, 0, 0.2, pile))]
sand = occ.cut(bed, slot)[0]
occ.synchronize()
gmsh.model.addPhysicalGroup(2, [tag for _, tag in sand], 1)
gmsh.model.mesh.setSize(gmsh.model.getEntities(0), size)
toe = gmsh.model.getEntitiesInBoundingBox(dam - 1, -pile - 1, -1, dam + 1, -pile + 1, 1, 0)
gmsh.model.mesh.setSize(toe, size / 10)
gmsh.model.mesh.generate(2)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

spaces = Spaces.petrov_galerkin(mesh, 0)
V = spaces.trial
h, v = ufl.TrialFunction(V), ufl.TestFunction(spaces.test)
K = assemble_matrix(permeability * ufl.inner(ufl.grad(h), ufl.grad(v)) * ufl.dx)
before = prescribe(V, 0, lambda x: np.isclose(x[1], 0) & (x[0] < -dam + 1e-9), head)
behind = prescribe(V, 0, lambda x: np.isclose(x[1], 0) & (x[0] > dam + 0.1 - 1e-9), 0.0)
f = K.createVecLeft()
a = solve(K, f, Reduction.dirichlet(V, [before, behind]))
out = nodal_flux(spaces, reactions(K, a, f), lambda x: np.isclose(x[1], 0) & (x[0] > dam + 0.09))
litres = -out.reaction.sum() * 1000 * 3600

figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
above = axes.inset_axes((0, 1.05, 1, 0.35), sharex=axes)
draw(mesh, as_function(V, a), axes=axes, label="head [m]", colours="Blues", edges=False)
axes.fill([-dam, dam, dam, -dam / 2, -dam], [0, 0, 1.5, head + 1, head + 1], color="0.6")
axes.fill_between([-length / 2, -dam], 0, head, color="#4a90c4", alpha=0.4)
x, speed = out.surface.position[:, 0], -out.flux * 1e6
above.fill_between(x, 0, speed, color="#D55E00", alpha=0.6)
above.tick_params(labelbottom=False)
above.set(ylabel="seepage [µm/s]", ylim=0)
above.set_title(f"{litres:.0f} litres an hour and metre", y=0.7)
axes.set(xlabel="x [m]", ylabel="y [m]")
if MPI.COMM_WORLD.rank == 0:
    figure.savefig("seepage.png", dpi=150)
    print(f"{litres:.1f} litres an hour and metre of the dam's length")
