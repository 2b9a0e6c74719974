"""Young's modulus and friction of rubber, found from a record of a roller pushed along it.

A roller is pressed into a block and then slid; both forces are measured on the way. SciPy's least
squares find modulus and coefficient of friction, with derivatives of the whole history by both of
them, `ContactProblem.sensitivity`. The record is made up here: known values, a finer mesh, noise.
"""

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem
from scipy.optimize import least_squares

from pw_elements import Spaces, prescribe
from pw_elements.contact import ContactPair, ContactProblem, Motion, Sphere
from pw_elements.meshes import triangles

cells, nu = 6, 0.45  # over the height of 1 mm
truth, start, noise = (2.4, 0.35), (1.0, 0.1), 0.01  # E [MPa] and mu; N/mm
slides = np.linspace(0, 0.3, 7)
path = [(0, -0.05), (0, -0.1), *((slide, -0.1) for slide in slides[1:])]


class Block:
    """The block, and the history of its contact for a modulus and a coefficient of friction."""

    def __init__(self, cells):
        mesh = triangles(MPI.COMM_WORLD, (-1.5, -1), (1.5, 0), (3 * cells, cells), "crossed")
        spaces = Spaces.petrov_galerkin(mesh)
        self.u, self.E = fem.Function(spaces.trial), fem.Constant(mesh, 1.0)
        F, v = ufl.Identity(2) + ufl.grad(self.u), ufl.TestFunction(spaces.test)
        F_T, G = ufl.inv(F).T, self.E / (2 * (1 + nu))
        stress = G * (F - F_T + 2 * nu / (1 - 2 * nu) * ufl.ln(ufl.det(F)) * F_T)
        self.residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})
        self.held = [prescribe(spaces.trial, i, lambda x: np.isclose(x[1], -1)) for i in (0, 1)]

    def forces(self, E_and_mu):
        """Both forces after each step, one after the other."""
        self.E.value, mu = E_and_mu
        pair = ContactPair(lambda x: np.isclose(x[1], 0), Sphere((0, 1), 1.0), friction=mu)
        self.problem = ContactProblem.of_residual(self.residual, self.u, self.held, pair)
        self.states = [self.problem.undeformed]
        for place in path:
            self.states.append(self.problem.step(self.states[-1], motions=Motion(place)))
        return np.ravel([state.pairs[0].force for state in self.states[1:]])

    def slopes(self, _):
        """Derivatives of the forces that have been computed last."""
        outputs, parameters = [("force", 0, 0), ("force", 0, 1)], [self.E, ("friction", 0)]
        return self.problem.sensitivity(self.states, outputs, parameters).reshape(-1, 2)


measured = Block(2 * cells).forces(truth)
measured += noise * np.random.default_rng(1).normal(size=len(measured))
block = Block(cells)
fit = least_squares(lambda p: block.forces(p) - measured, start, block.slopes, bounds=(0.01, 10))
spread = noise * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))

figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
steps = np.arange(1, len(path) + 1)
for forces, line in ((block.forces(start), ":"), (block.forces(fit.x), "-")):
    for component, colour in zip(forces.reshape(-1, 2).T, ("C1", "C0"), strict=True):
        axes.plot(steps, np.abs(component), line, color=colour)
for k, name in enumerate(("tangential", "normal")):
    axes.plot(steps, np.abs(measured[k::2]), "o", color=("C1", "C0")[k], label=name)
axes.set(xlabel="step: two down, then along", ylabel="force on the roller [N/mm]")
axes.legend(title="measured; dotted: first guess", loc=(0.5, 0.52))
if MPI.COMM_WORLD.rank == 0:
    figure.savefig("identify.png", dpi=150)
    for name, value, error, known in zip(("E", "mu"), fit.x, spread, truth, strict=True):
        print(f"{name} = {value:.4f} +- {error:.4f}, made with {known}, {fit.nfev} histories")
