"""Large strains by any residual: a neo-Hookean block below a rigid punch that sticks.

The weights enter a nonlinear residual as they do a linear one. Known are the order of Newton's
method, and that a body which is turned has its forces turned; what is measured besides is how even
nodal forces are, and the moment that they have about the deformed nodes.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from pw_elements import PetrovGalerkinProblem, prescribe
from pw_elements.meshes import triangles
from pw_elements.recovery import forces_along
from study.core.cases import Case
from study.core.store import Result
from study.discretisation import spaces
from study.units import dimensionless

TITLE = "Large strains: a rubber block below a punch"

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Lengths over the block's height, stresses over the shear modulus; plane strain
HALF_WIDTH, HALF_PUNCH = 1.0, 0.5
LAME = 1.5
DOWN, ASIDE = 0.2, 0.1
ROUND_OFF = 1e-11  # corrections below this are rounded off in their fourth digit
ANGLE = 0.7  # by which the deformed block is turned
DEGREE = 6  # of quadrature: above it nothing changes but round-off and some 1e-6


def punch(element: str, elements: int) -> Result:
    """The block with `elements` over its height, pressed, and pressed while it is turned."""
    block = _Block(element, elements)
    down = fem.Constant(block.space.mesh, -DOWN)
    aside = fem.Constant(block.space.mesh, ASIDE)
    moves = [prescribe(block.space, 1, _above, down), prescribe(block.space, 0, _above, aside)]
    held = [prescribe(block.space, i, _below) for i in (0, 1)]
    problem = PetrovGalerkinProblem(block.residual, block.u, [*moves, *held])
    problem.solve([down, aside])
    forces = problem.reactions()
    (increment,) = problem.increments
    corrections = np.array(increment.corrections)

    line = forces_along(block.space, forces, _above)
    force = -line.force[:, 1]
    middle, corners = force[3:-3:2], (force[2:-4:2] + force[4:-2:2]) / 2
    first, second, third = np.log(corrections[corrections > ROUND_OFF][-3:])
    scalars = {
        "newton_rate": (third - second) / (second - first),
        "newton_iterations": len(corrections),
        "last_correction": corrections[-1],
        "objectivity": block.objectivity(forces),
        "sawtooth": np.median(middle / corners),
        "moment_defect": block.moment_defect(forces),
        "force": force.sum(),
    }
    curves = {
        "x": line.position[:, 0],
        "force": force / force.mean(),
        "corrections": corrections,
        "nodes": block.x,
        "deformed": block.x + block.displacement,
        "cells": block.space.dofmap.list.copy(),
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=2 * len(block.x))


class _Block:
    """Spaces, unknown and residual of a block on an element."""

    def __init__(self, element: str, elements: int) -> None:
        divisions = (round(2 * HALF_WIDTH * elements), elements)
        mesh = triangles(MPI.COMM_SELF, (-HALF_WIDTH, 0.0), (HALF_WIDTH, 1.0), divisions)
        pair = spaces(element, mesh)
        self.space, self.u = pair.trial, fem.Function(pair.trial)
        self.x: Array = self.space.tabulate_dof_coordinates()[:, :2]
        self._weights = ufl.TestFunction(pair.test)
        self.residual = self.residual_of(self.u)

    @property
    def displacement(self) -> Array:
        """Of the nodes, (n, 2)."""
        return np.asarray(self.u.x.array.reshape(-1, 2))

    def residual_of(self, u: fem.Function) -> ufl.Form:
        """First Piola-Kirchhoff stress times the weights' gradients."""
        F = ufl.Identity(2) + ufl.grad(u)
        inverse = ufl.inv(F).T
        stress = F - inverse + LAME * ufl.ln(ufl.det(F)) * inverse
        dx = ufl.dx(metadata={"quadrature_degree": DEGREE})
        return ufl.inner(stress, ufl.grad(self._weights)) * dx

    def objectivity(self, forces: PETSc.Vec) -> float:
        """Largest difference of forces when the block is turned, too, over the largest one."""
        moved, turned, given = self.displacement, fem.Function(self.space), fem.Function(self.space)
        nodes = np.flatnonzero(_above(self.x.T) | _below(self.x.T)).astype(np.int32)

        def turn(share: float) -> None:
            now = (self.x + share * moved) @ _rotation(share * ANGLE).T - self.x
            given.x.array[:] = now.ravel()

        again = PetrovGalerkinProblem(
            self.residual_of(turned), turned, fem.dirichletbc(given, nodes)
        )
        again.solve(turn, increments=2)
        expected = forces.array_r.reshape(-1, 2) @ _rotation(ANGLE).T
        difference = again.reactions().array_r.reshape(-1, 2) - expected
        return float(np.abs(difference).max() / np.abs(expected).max())

    def moment_defect(self, forces: PETSc.Vec) -> float:
        """Sum of the moments of nodal forces about deformed nodes, over that of magnitudes."""
        place, force = self.x + self.displacement, forces.array_r.reshape(-1, 2)
        moments = place[:, 0] * force[:, 1] - place[:, 1] * force[:, 0]
        return float(abs(moments.sum()) / np.abs(moments).sum())


def _rotation(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _above(x: Array) -> Mask:
    return np.isclose(x[1], 1.0) & (np.abs(x[0]) < HALF_PUNCH + 1e-9)


def _below(x: Array) -> Mask:
    return np.isclose(x[1], 0.0)


CASES = [
    Case("V14", f"punch-{element}-{n}", punch, {"element": element, "elements": n})
    for element in ("galerkin-T6", "pw-T6")
    for n in (4, 8, 16)
]
