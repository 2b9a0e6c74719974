"""A gasket between two flanges, bolted and then under pressure.

A mesh file, two materials, two bodies, friction. A pipe joint as a solid of revolution; its middle
plane is one of symmetry, so that half of the gasket (1.5 mm) and one flange are in `gasket.msh`,
which `gasket_mesh.py` makes. The bolts bend the flange, and the gasket seals at its outer edge. The
pressure in the pipe takes off part of that.
"""

from pathlib import Path


import matplotlib.pyplot as plt
import numpy as np
import ufl

from pw_elements import (
    Body, Material, Reduction, Spaces, as_function, assemble_matrix, assemble_vector,
    boundary_measure, draw,
)
from pw_elements.contact import ContactFields, ContactPair, DeformableSurface, solve_contact
from pw_elements.meshes import from_file
from dolfinx import fem  # after pw_elements, which prepares the one that pip installs

STEEL, FIBRE, MIDDLE, SEAL, FACE, BOLTS, WET, END = range(1, 9)  # the file's physical groups
bolts, pressure = 150e3, 3.0  # N, MPa
mesh, cells, facets, _ = from_file(Path(__file__).with_name("gasket.msh"))

steel, fibre = Material(210e3, 0.3), Material(600.0, 0.3)
both = Material.by_tag(mesh, cells, {STEEL: steel, FIBRE: fibre})
joint = Body(Spaces.petrov_galerkin(mesh), both, "axisymmetric")
U = joint.spaces.trial
K = assemble_matrix(joint.stiffness())
middle = fem.locate_dofs_topological(U.sub(1), 1, facets.find(MIDDLE))
held = Reduction.dirichlet(U, fem.dirichletbc(0.0, middle, U.sub(1)))


def load(traction, part):
    measure = boundary_measure(mesh, facets.find(part))
    return assemble_vector(joint.surface_load(traction, measure))


tightened = load((0, -bolts / (np.pi * (102**2 - 88**2))), BOLTS)
inside = load(-pressure * ufl.FacetNormal(mesh), WET)
thrust = load((0, pressure * 50**2 / (58**2 - 50**2)), END)  # of the pipe's closed end
seal = fem.locate_dofs_topological(U, 1, facets.find(SEAL))
pair = ContactPair(seal, DeformableSurface(facets.find(FACE)), friction=0.2)
states = solve_contact(K, [tightened, tightened + inside + thrust], held, pair, U)

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.4), layout="constrained")
u = as_function(U, states[-1].displacement)
draw(mesh, joint.von_mises(u), u, scale=20, axes=left, edges=False,
     limits=(0, 120), label="von Mises stress [MPa]")
left.set(ylim=(-4, 75), xlabel="r [mm]", ylabel="z [mm]", title="Displacements × 20")
for state, name in zip(states, ("bolted", "under pressure"), strict=True):
    fields = ContactFields.from_state(state, joint)
    (own,), (opposite,), (contact,) = fields.surfaces, fields.opposite, state.pairs
    on_gasket, on_flange = own.pressure(contact.force_normal), opposite.results(contact).pressure
    (line,) = right.plot(own.position[:, 0], on_gasket, ".-", label=f"gasket, {name}")
    right.plot(opposite.surface.position[:, 0], on_flange, "o", mfc="none", c=line.get_color(),
               label=f"flange, {name}")
right.axhline(pressure, color="k", ls="--", label="pressure to be sealed")
right.set(xlabel="r [mm]", ylabel="pressure [MPa]", ylim=0)
right.legend(frameon=False)
if mesh.comm.rank == 0:
    figure.savefig("gasket.png", dpi=150)
    print("the gasket carries", *(f"{-state.pairs[0].force[1] / 1e3:.0f} kN" for state in states))
