"""A hot aluminium block pressed on a steel block: heat and contact pressure depend on each other.

The joint conducts heat in proportion to the pressure to the power 0.95 (Cooper, Mikic, Yovanovich
1969), and its air conducts a little. Heat bends the blocks, which moves the pressure and with it
the flow of heat. Contact and temperatures are solved for in turn. Half of the joint, in plane
strain.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import create_submesh, locate_entities, locate_entities_boundary

from pw_elements import (
    Body, Material, Reduction, Spaces, as_function, assemble_matrix, assemble_vector,
    boundary_measure, draw, prescribe, solve,
)
from pw_elements.conduction import interface_conduction
from pw_elements.contact import ContactFields, ContactPair, ContactProblem, DeformableSurface
from pw_elements.meshes import move_nodes, triangles

cells, side = 20, 20.0  # cells along a block's side; mm
load, cold, hot = 20.0, 20.0, 220.0  # MPa, °C, °C

whole = triangles(MPI.COMM_WORLD, (0, 0), (side, 3 * side), (cells, 3 * cells))
blocks = locate_entities(whole, 2, lambda x: (x[1] < 1.01 * side) | (x[1] > 1.99 * side))
apart = create_submesh(whole, 2, blocks)[0]
faces = [locate_entities_boundary(apart, 1, lambda x, k=k: np.isclose(x[1], k * side))
         for k in (1, 2)]
mesh = move_nodes(apart, lambda x: x[:, :2] - np.outer(x[:, 1] > 1.5 * side, [0, side]))
is_hot = ufl.gt(ufl.SpatialCoordinate(mesh)[1], side)
E, expansion = ufl.conditional(is_hot, 70e3, 210e3), ufl.conditional(is_hot, 23e-6, 12e-6)
conductivity = ufl.conditional(is_hot, 0.2, 0.05)  # W/(mm K)

body = Body(Spaces.petrov_galerkin(mesh), Material(E, 0.3), "plane strain")
U, v, K = body.spaces.trial, ufl.TestFunction(body.spaces.test), assemble_matrix(body.stiffness())
cuts = [prescribe(U, i, lambda x, i=i: np.isclose(x[i], 0)) for i in (0, 1)]
pair = ContactPair(fem.locate_dofs_topological(U, 1, faces[1]), DeformableSurface(faces[0]))
problem = ContactProblem(K, Reduction.dirichlet(U, cuts), pair, U)
pressing = body.surface_load((0, -load), boundary_measure(mesh, lambda x: x[1] > 1.99 * side))

heat = Spaces.petrov_galerkin(mesh, 0)
T, w = ufl.TrialFunction(heat.trial), ufl.TestFunction(heat.test)
conduction = assemble_matrix(conductivity * ufl.inner(ufl.grad(T), ufl.grad(w)) * ufl.dx)
ends = [prescribe(heat.trial, 0, lambda x, y=y: np.isclose(x[1], y), value)
        for y, value in ((0, cold), (2 * side, hot))]
temperature, pressures, change = fem.Function(heat.trial), [], np.inf
temperature.x.array[:] = cold
while change > 1e-3:  # K
    stress = E * expansion * (temperature - cold) / (1 - 2 * 0.3) * ufl.Identity(2)
    f = assemble_vector(ufl.inner(stress, body.strain(v)) * ufl.dx + pressing)
    state = problem.step(problem.undeformed, f)
    joint, _ = interface_conduction(
        state, body, heat, lambda p, gap: 0.75 * (p / 2e3) ** 0.95 + 2.6e-5 / (0.01 + gap)
    )
    old = temperature.x.array.copy()
    a = solve(conduction + joint, joint.createVecLeft(), Reduction.dirichlet(heat.trial, ends))
    as_function(heat.trial, a, out=temperature)
    change = mesh.comm.allreduce(np.abs(temperature.x.array - old).max(), MPI.MAX)
    surface, (contact,) = ContactFields.from_state(state, body).surfaces[0], state.pairs
    pressures.append(surface.pressure(contact.force_normal))

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 4.4), layout="constrained")
draw(mesh, temperature, as_function(U, state.displacement), scale=20, axes=left, edges=False,
     label="temperature [°C]")
left.set(xlabel="x [mm]", ylabel="y [mm]", title="Displacements × 20")
right.plot(contact.position[:, 0], np.transpose(pressures)[:, [0, -1]], ".-")
right.set(xlabel="x [mm]", ylabel="contact pressure [MPa]", ylim=0)
right.legend(["cold", "heated"], frameon=False)
if mesh.comm.rank == 0:
    figure.savefig("heated_joint.png", dpi=150)
    print(f"{len(pressures)} turns of contact and heat")
