"""Large strains by any residual: a neo-Hookean block below a rigid punch that sticks.

The weights enter a nonlinear residual as they do a linear one. Known are the order of Newton's
method, and that a body which is turned has its forces turned; what is measured besides is how even
nodal forces are, and the moment that they have about the deformed nodes.

In the plane a strip, in space a square block below a square punch.
"""

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box
from scipy.spatial.transform import Rotation

from pw_elements import PetrovGalerkinProblem, forces_along, prescribe
from pw_elements.meshes import triangles
from study.model.discretisation import spaces
from study.model.units import dimensionless
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.verification.v14_moment import (
    Stress,
    internal_work,
    linear_stress,
    moments,
    moments_of_triangles,
    neo_hookean,
    smooth,
)

SECTION = "V14"
TITLE = "Large strains: a rubber block below a punch"

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Lengths over the block's height; plane strain
HALF_WIDTH, HALF_PUNCH = 1.0, 0.5
DOWN, ASIDE = 0.2, 0.1
ROUND_OFF = 1e-11  # corrections below this are rounded off in their fourth digit
NEAR = 0.25  # to where the support of the boundary ends
ANGLE = 0.7  # by which the deformed block is turned
DEGREE = {2: 6, 3: 4}  # of quadrature: above it nothing changes but round-off and some 1e-6


def punch(element: str, elements: int) -> Result:
    """The block with `elements` over its height, pressed, and pressed while it is turned."""
    block = _Block(element, elements)
    space, dim = block.space, block.dim
    problem = block.press()
    forces = problem.reactions()
    (increment,) = problem.increments
    corrections = np.array(increment.relative_corrections)
    first, second, third = np.log(corrections[corrections > ROUND_OFF][-3:])
    pressed = block.above(block.x.T)
    scalars = {
        "newton_rate": (third - second) / (second - first),
        "newton_iterations": len(corrections),
        "last_correction": corrections[-1],
        "objectivity": block.objectivity(forces),
        "moment_defect": block.moment_defect(forces),
        "force": -forces.array_r.reshape(-1, dim)[pressed, -1].sum(),
    }
    curves = {
        "corrections": corrections,
        "nodes": block.x,
        "deformed": block.x + block.displacement,
        "cells": space.dofmap.list.copy(),
    }
    evenness, of_forces = (_along if dim == 2 else _across)(block, forces)
    if element == "pw-T6":
        evenness |= block.moment_defect_by_place(forces)
        evenness["volume_min"] = block.smallest_volume()
    numbers = {name: float(value) for name, value in (scalars | evenness).items()}
    return Result(numbers, dimensionless(numbers), curves | of_forces, dofs=block.x.size)


def linear(element: str, elements: int) -> Result:
    """The block of a material whose stress is linear in F, pressed."""
    block = _Block(element, elements, linear_stress)
    scalars = {"moment_defect": block.moment_defect(block.press().reactions())}
    return Result(scalars, dimensionless(scalars), {}, dofs=block.x.size)


class _Block:
    """Spaces, unknown and residual of a block on an element."""

    def __init__(self, element: str, elements: int, stress: Stress = neo_hookean) -> None:
        wide = round(2 * HALF_WIDTH * elements)
        if element.endswith("T6"):
            ends = (-HALF_WIDTH, 0.0), (HALF_WIDTH, 1.0)
            mesh = triangles(MPI.COMM_SELF, *ends, (wide, elements))
        else:
            corners = [(-HALF_WIDTH, -HALF_WIDTH, 0.0), (HALF_WIDTH, HALF_WIDTH, 1.0)]
            divisions = (wide, wide, elements)
            mesh = create_box(MPI.COMM_SELF, corners, divisions, CellType.tetrahedron)
        self.dim: int = mesh.geometry.dim
        self.elements = elements
        pair = spaces(element, mesh)
        self.space, self.u = pair.trial, fem.Function(pair.trial)
        self.x: Array = self.space.tabulate_dof_coordinates()[:, : self.dim]
        self._weights, self._stress = ufl.TestFunction(pair.test), stress
        self.residual = self.residual_of(self.u)

    @property
    def displacement(self) -> Array:
        """Of the nodes, (n, dim)."""
        return np.asarray(self.u.x.array.reshape(-1, self.dim))

    def above(self, x: Array) -> Mask:
        """Marker of what sticks to the punch."""
        beside = np.abs(x[: self.dim - 1]).max(axis=0)
        return np.isclose(x[self.dim - 1], 1.0) & (beside < HALF_PUNCH + 1e-9)

    def below(self, x: Array) -> Mask:
        """Marker of the base."""
        return np.isclose(x[self.dim - 1], 0.0)

    def residual_of(self, u: fem.Function) -> ufl.Form:
        """The weak form, without loads."""
        return internal_work(u, self._weights, DEGREE[self.dim], self._stress)

    def press(self) -> PetrovGalerkinProblem:
        """The problem, solved for the punch's whole way."""
        space = self.space
        down, aside = fem.Constant(space.mesh, -DOWN), fem.Constant(space.mesh, ASIDE)
        last = self.dim - 1
        moves = [prescribe(space, last, self.above, down), prescribe(space, 0, self.above, aside)]
        moves += [prescribe(space, axis, self.above) for axis in range(1, last)]
        held = [prescribe(space, axis, self.below) for axis in range(self.dim)]
        problem = PetrovGalerkinProblem(self.residual, self.u, [*moves, *held])
        problem.solve([down, aside])
        return problem

    def objectivity(self, forces: PETSc.Vec) -> float:
        """Largest difference of forces when the block is turned, too, over the largest one."""
        moved, turned, given = self.displacement, fem.Function(self.space), fem.Function(self.space)
        nodes = np.flatnonzero(self.above(self.x.T) | self.below(self.x.T)).astype(np.int32)

        def turn(share: float) -> None:
            now = (self.x + share * moved) @ _rotation(share * ANGLE, self.dim).T - self.x
            given.x.array[:] = now.ravel()

        again = PetrovGalerkinProblem(
            self.residual_of(turned), turned, fem.dirichletbc(given, nodes)
        )
        again.solve(turn, increments=2)
        expected = forces.array_r.reshape(-1, self.dim) @ _rotation(ANGLE, self.dim).T
        difference = again.reactions().array_r.reshape(-1, self.dim) - expected
        return float(np.abs(difference).max() / np.abs(expected).max())

    def moment_defect(self, forces: PETSc.Vec) -> float:
        """Sum of the moments of nodal forces about deformed nodes, over that of magnitudes."""
        each = self._moments(forces)
        return float(np.linalg.norm(each.sum(axis=0)) / np.linalg.norm(each, axis=1).sum())

    def moment_defect_by_place(self, forces: PETSc.Vec) -> dict[str, float]:
        """What triangles add to it near both ends of the punch, and far from where supports end."""
        middle = self.x[self.space.dofmap.list[:, :3]].mean(axis=1)
        corners = np.array([(-HALF_PUNCH, 1), (HALF_PUNCH, 1), (-HALF_WIDTH, 0), (HALF_WIDTH, 0)])
        near = np.linalg.norm(middle[:, None] - corners, axis=2) < NEAR
        share = moments_of_triangles(self.u, DEGREE[2], self._stress)
        share /= np.linalg.norm(self._moments(forces), axis=1).sum()
        places = {"left": near[:, 0], "right": near[:, 1], "far": ~near.any(axis=1)}
        return {f"moment_defect_{name}": share[cells].sum() for name, cells in places.items()}

    def smallest_volume(self) -> float:
        """Least det F, at the rule's points."""
        points, _ = basix.make_quadrature(self.space.mesh.basix_cell(), DEGREE[self.dim])
        volume = fem.Expression(ufl.det(ufl.Identity(self.dim) + ufl.grad(self.u)), points)
        return float(volume.eval(self.space.mesh, np.arange(len(self.space.dofmap.list))).min())

    def _moments(self, forces: PETSc.Vec) -> Array:
        return moments(self.x + self.displacement, forces.array_r.reshape(-1, self.dim))


def _along(block: _Block, forces: PETSc.Vec) -> tuple[dict[str, float], dict[str, Array]]:
    """How even forces are along the punch in the plane."""
    line = forces_along(block.space, forces, block.above)
    force = -line.force[:, 1]
    middle, corners = force[3:-3:2], (force[2:-4:2] + force[4:-2:2]) / 2
    curves = {"x": line.position[:, 0], "force": force / force.mean()}
    return {"sawtooth": float(np.median(middle / corners))}, curves


def _across(block: _Block, forces: PETSc.Vec) -> tuple[dict[str, float], dict[str, Array]]:
    """How even forces are below the punch in space, on the nodes that are not on its rim."""
    inside = np.abs(block.x[:, :2]).max(axis=1) < HALF_PUNCH - 1e-9
    nodes = np.flatnonzero(block.above(block.x.T) & inside)
    x, force = block.x[nodes], -forces.array_r.reshape(-1, 3)[nodes, 2]
    corner = np.isclose(x * block.elements, np.round(x * block.elements)).all(axis=1)
    middle = np.median(force[~corner])
    scalars = {
        "corner_over_middle": np.median(force[corner]) / middle,
        "drawing": np.mean(force < 0),
    }
    return scalars, {"x": x, "force": force / force.mean()}


def _rotation(angle: float, dim: int) -> Array:
    """About the normal of the plane, or the diagonal of space."""
    if dim == 2:
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, -s], [s, c]])
    return np.asarray(Rotation.from_rotvec(angle * np.ones(3) / np.sqrt(3)).as_matrix())


def _cases(cell: str, sizes: tuple[int, ...]) -> list[Case]:
    return [
        Case("V14", f"punch-{element}-{n}", punch, {"element": element, "elements": n})
        for element in (f"galerkin-{cell}", f"pw-{cell}")
        for n in sizes
    ]


def _smooth(cell: str, sizes: tuple[int, ...]) -> list[Case]:
    element = f"pw-{cell}"
    return [
        Case("V14", f"smooth-{element}-{n}", smooth, {"element": element, "elements": n})
        for n in sizes
    ]


CASES = [*_cases("T6", (4, 8, 16)), *_smooth("T6", (4, 8, 16))]
CASES += [Case("V14", "linear-pw-T6-8", linear, {"element": "pw-T6", "elements": 8})]
CASES += mark_costly([*_cases("T6", (32, 64)), *_cases("T10", (2, 4, 8))])
CASES += mark_costly([Case("V14", "punch-pw-T6-96", punch, {"element": "pw-T6", "elements": 96})])
CASES += mark_costly([*_smooth("T6", (32, 64)), *_smooth("T10", (2, 4, 8))])
