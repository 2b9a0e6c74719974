"""A polymer pin worn on a steel plate: how the round tip becomes flat and the pressure even.

A constant force presses the pin, and the plate slides below it; each increment stands for many
strokes. The worn depth grows by Archard's law: by a coefficient times pressure times slip. It opens
the gap of the next increment, so that the pressure spreads. The worn volume is the coefficient
times force times path, and the flat tip that has this volume gives the half width in the end.
"""

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.contact import ContactFields, ContactPair, ContactProblem, Motion, Plane
from pw_elements.contact.model import UnilateralContact
from pw_elements.meshes import from_gmsh

size = 0.12  # mm, of the elements at the tip
radius, half_width, height = 20.0, 2.0, 3.0  # mm
force, slip, increments = 20.0, 0.05, 400  # N/mm, mm
wear = 2e-4  # 1/MPa; a realistic coefficient of 2e-7 times a thousand strokes in each increment

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
disk = occ.addDisk(0, radius, 0, radius, radius)
box = occ.addRectangle(-half_width, 0, 0, 2 * half_width, height)
pin = occ.intersect([(2, disk)], [(2, box)])[0]
occ.synchronize()
gmsh.model.addPhysicalGroup(2, [pin[0][1]], 1)
field = gmsh.model.mesh.field
sizes = field.add("MathEval")
field.setString(sizes, "F", f"{size} + 0.15 * y")
field.setAsBackgroundMesh(sizes)
gmsh.model.mesh.generate(2)
gmsh.model.mesh.setOrder(2)
mesh, *_ = from_gmsh(MPI.COMM_WORLD, gmsh.model)
gmsh.finalize()

body = Body(Spaces.petrov_galerkin(mesh), Material(2000.0, 0.4), "plane strain")
U, K = body.spaces.trial, assemble_matrix(body.stiffness())
held = Reduction.dirichlet(U, [prescribe(U, i, lambda x: np.isclose(x[1], height)) for i in (0, 1)])
law = UnilateralContact(friction=0.1, wear_coefficient=wear)
tip = ContactPair(
    lambda x: np.isclose(np.hypot(x[0], x[1] - radius), radius), Plane((0, 0), (0, 1)),
    interface_law=law,
)
problem = ContactProblem(K, held, tip, U)
pressed = problem.step(problem.undeformed, motions=Motion((0, 0.02)))
states = [problem.step(pressed, motions=Motion((0, None), force=(0, force)))]
for k in range(increments):
    motion = Motion((slip * (k + 1), None), force=(0, force))
    states.append(problem.step(states[-1], motions=motion))
(surface,) = ContactFields.from_state(states[0], body).surfaces
depths = [state.pairs[0].law_history[:, 3] for state in states]
volume = depths[-1] @ surface.weight_area

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
x = states[0].pairs[0].position[:, 0]
for k in [0, *np.array([0.1, 0.3, 0.6, 1.0]) * increments]:
    (pair,) = states[int(k)].pairs
    left.plot(x, surface.pressure(pair.force_normal), ".-", label=f"{slip * k:g} mm")
    right.plot(x, 1000 * depths[int(k)], ".-")
flat = np.cbrt(1.5 * radius * volume)  # half width of a flat tip with this volume
left.plot([-flat, flat], 2 * [force / (2 * flat)], "k--", label="flat tip")
left.set(xlabel="x [mm]", ylabel="pressure [MPa]", xlim=(-1.8, 1.8), ylim=0)
right.set(xlabel="x [mm]", ylabel="worn depth [µm]", xlim=(-1.8, 1.8), ylim=0)
left.legend(title="path", frameon=False)
if mesh.comm.rank == 0:
    figure.savefig("worn_pin.png", dpi=150)
    print(f"worn volume {volume:.4f} mm³/mm; half width of a flat tip {flat:.2f} mm")
