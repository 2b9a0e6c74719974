"""An O-ring of incompressible rubber between two plates: large strains, a pressure as unknown."""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from pw_elements import PetrovGalerkinProblem, Spaces, as_function, draw, split
from pw_elements.meshes import curved_mesh, triangles

cells = 16  # across the cord, whose radius is 1 mm
ring, mu, squeeze, steps = 8.0, 1.0, 0.25, 10  # mm, MPa, part of the cord's diameter
square = triangles(MPI.COMM_WORLD, (-1, -1), (1, 1), (cells, cells), "crossed")
mesh = curved_mesh(square, lambda x: x * np.sqrt(1 - x[:, [1, 0, 2]] ** 2 / 2) + [ring, 0, 0])
spaces = Spaces.hybrid(mesh)
W, w = spaces.trial, fem.Function(spaces.trial)
(u, p), (v, q) = ufl.split(w), ufl.split(ufl.TestFunction(spaces.test))
r = ufl.SpatialCoordinate(mesh)[0]


def gradient(a):
    g = ufl.grad(a)
    return ufl.as_tensor([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, a[0] / r]])


F = ufl.Identity(3) + gradient(u)
J, cofactor = ufl.det(F), ufl.inv(F).T
stress = mu * (F - cofactor) - p * J * cofactor  # neo-Hookean, first Piola-Kirchhoff
work = ufl.inner(stress, gradient(v)) - q * (J - 1)
conditions = []
residual = 2 * np.pi * r * work * ufl.dx(metadata={"quadrature_degree": 5})
problem = PetrovGalerkinProblem(residual, w, conditions)

# plates are flat and smooth: a node in contact has a known displacement across, or is let go
across, unknowns = W.sub(0).sub(1).collapse()
x, y = across.tabulate_dof_coordinates()[:, :2].T
rim, unknowns = np.hypot(x - ring, y) > 1 - 1e-9, np.ravel(unknowns)
held, target = np.zeros(len(y), dtype=bool), fem.Function(W)
for height in 1 - squeeze * np.arange(1, steps + 1) / steps:
    held |= rim & (np.abs(y + w.x.array[unknowns]) > height)
    for _ in range(20):
        target.x.array[unknowns] = np.sign(y) * height - y
        conditions[:] = [fem.dirichletbc(target, np.sort(unknowns[held]).astype(np.int32))]
        problem.solve()
        push = -np.sign(y) * as_function(W, problem.reactions()).x.array[unknowns]
        passed = rim & (np.abs(y + w.x.array[unknowns]) > height)
        found = np.where(held, push > 0, passed)
        held, before = found, held
        if mesh.comm.allreduce(np.array_equal(held, before), MPI.LAND):
            break
own = np.arange(len(y)) < across.dofmap.index_map.size_local
force = mesh.comm.allreduce(push[held & own & (y > 0)].sum())

moved, pressure = split(W, w.x.petsc_vec)
axes = draw(mesh, pressure, moved, label="pressure [MPa]", colours="magma")
axes.axhspan(height, 1, color="0.6"), axes.axhspan(-1, -height, color="0.6")
axes.set(xlabel="r [mm]", ylabel="z [mm]")
if mesh.comm.rank == 0:
    axes.figure.savefig("seal.png", dpi=150)
    print(f"force of the plates: {force:.2f} N, {force / (2 * np.pi * ring):.3f} N/mm")
