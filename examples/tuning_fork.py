"""The tones of a tuning fork, held at its handle: tetrahedra from Gmsh."""

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np
import ufl

from pw_elements import (
    Body, Material, Reduction, Spaces, as_function, assemble_matrix, draw, prescribe,
    vibration_modes,
)
from pw_elements.meshes import from_gmsh

size = 4.0  # mm, of the elements
prong, thick, wide, gap, handle = 82.5, 4.5, 6.0, 9.0, 35.0  # mm

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ, outer = gmsh.model.occ, gap / 2 + thick
sides = [(3, occ.addBox(x, -wide / 2, 0, thick, wide, prong)) for x in (gap / 2, -outer)]
bow = occ.cut(
    [(3, occ.addCylinder(0, -wide / 2, 0, 0, wide, 0, outer))],
    [(3, occ.addCylinder(0, -wide / 2, 0, 0, wide, 0, gap / 2)),
     (3, occ.addBox(-20, -20, 0, 40, 40, 20))],
)[0]
stem = [(3, occ.addBox(-thick / 2, -wide / 2, -outer - handle, thick, wide, handle + thick / 2))]
fork = occ.fuse(sides, [*bow, *stem])[0]
occ.synchronize()
gmsh.model.addPhysicalGroup(3, [tag for _, tag in fork], 1)
gmsh.option.setNumber("Mesh.MeshSizeMax", size)
gmsh.model.mesh.generate(3)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

steel = Body(Spaces.petrov_galerkin(mesh), Material(206e3, 0.3, 7.85e-9), "solid")  # N, mm, t, s
U = steel.spaces.trial
end = [prescribe(U, i, lambda x: x[2] < -outer - handle + 1e-6) for i in range(3)]
K, M = assemble_matrix(steel.stiffness()), assemble_matrix(steel.mass())
modes = vibration_modes(K, M, Reduction.dirichlet(U, end), count=8)
tones = np.sqrt(modes.eigenvalues) / (2 * np.pi)

figure, axes = plt.subplots(1, 4, figsize=(10, 5), layout="constrained")
for ax, k in zip(axes, (2, 3, 4, 6), strict=True):
    u = as_function(U, modes.shapes[k])
    draw(mesh, ufl.sqrt(ufl.inner(u, u)), u, scale=12, axes=ax, colours="plasma", view=(15, -65))
    ax.set(title=f"{tones[k]:.0f} Hz")
if mesh.comm.rank == 0:
    figure.savefig("tuning_fork.png", dpi=150)
    print("tones:", ", ".join(f"{tone:.0f}" for tone in tones), "Hz")
