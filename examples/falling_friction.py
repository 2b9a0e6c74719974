"""A law of friction of one's own: a coefficient that falls with the pressure of each node.

A floor slides below a block, whose top is held along the floor and pressed on it. Shear on the
sides keeps its stress uniform, so that the friction is known: mu / (1 + p / p_0) of the pressure p.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np

from pw_elements import (
    Body, Iterative, Material, Reduction, Spaces, SurfaceNodes, assemble_matrix, assemble_vector,
    boundary_measure, prescribe,
)
from pw_elements.contact import ContactPair, Motion, Plane, solve_contact
from pw_elements.meshes import triangles

mu, p_0 = 0.6, 20.0  # MPa, the pressure at which the coefficient has halved


class Falling:
    """|r_t| <= mu r_n / (1 + p / p_0), with p = r_n / A the pressure of a node of area A."""

    def __init__(self, nodes):
        self.nodes = nodes

    def parameter_at(self, x):  # p_0 A
        order = np.argsort(self.nodes.position[:, 0])
        return p_0 * np.interp(x[0], self.nodes.position[order, 0], self.nodes.weight_area[order])

    def limit(self, half, force):
        share = half / (half + force)
        return mu * share * force, mu * share**2


comm = MPI.COMM_WORLD
mesh = triangles(comm, (0.0, 0.0), (4.0, 2.0), (8, 4))
body = Body(Spaces.petrov_galerkin(mesh), Material(10e3), "plane stress")
U, K = body.spaces.trial, assemble_matrix(body.stiffness())
left, right, top, bottom = (
    lambda x, i=i, at=at: np.isclose(x[i], at) for i, at in ((0, 0), (0, 4), (1, 2), (1, 0))
)
held = Reduction.dirichlet(U, prescribe(U, 0, top))
slides = Motion((0.1, 0.0))  # mm
friction = Falling(SurfaceNodes.from_body(body, bottom))
floor = ContactPair(bottom, Plane((0, 0), (0, 1)), friction, slides)
pressures, found = np.array([5.0, 20.0, 60.0]), {"factors": [], "Krylov's method": []}
for p in pressures:
    tau = mu * p / (1 + p / p_0)
    tractions = {top: (0, -p), left: (0, tau), right: (0, -tau)}
    f = sum(assemble_vector(body.surface_load(np.array(t, float), boundary_measure(mesh, side)))
            for side, t in tractions.items())
    for name, solver in (("factors", None), ("Krylov's method", Iterative())):
        (state,) = solve_contact(K, f, held, floor, U, solver=solver)
        friction, pressing = state.pairs[0].force
        found[name].append(friction / pressing)

figure, axes = plt.subplots(figsize=(5.5, 3.8), layout="constrained")
p = np.linspace(0, 70)
axes.plot(p, mu / (1 + p / p_0), "k--", label="as the law says")
for (name, ratio), style in zip(found.items(), ("o", "x"), strict=True):
    axes.plot(pressures, ratio, style, label=f"found by {name}")
axes.set(xlabel="pressure [MPa]", ylabel="friction over pressing force", ylim=(0, 0.65))
axes.legend(frameon=False)
if comm.rank == 0:
    figure.savefig("falling_friction.png", dpi=150)
    for name, ratio in found.items():
        error = np.abs(ratio / (mu / (1 + pressures / p_0)) - 1).max()
        print(f"{name}: {', '.join(f'{r:.4f}' for r in ratio)}; off by {error:.0e}")
