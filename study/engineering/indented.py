"""Hertz' contacts of section Q with nodal forces of an element, for what comes after contact."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements import Body, Material, Spaces, SurfaceNodes
from pw_elements.elasticity import StressState
from study.meshes.mesh_lines import PLACE
from study.rivals import pw_t6, snes_vi
from study.rivals.problem import NU, E, Problem, line, sphere

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Indented:
    """The half plane below a parabola, or the half space below a paraboloid.

    Args:
        problem: mesh and exact solution.
        u: displacements.
        surface: nodes that may touch, m.
        force: (m,), of the indenter on them.
    """

    problem: Problem
    u: fem.Function
    surface: SurfaceNodes
    force: Array

    @classmethod
    def of(cls, element: str, edges: int) -> "Indented":
        """Solves it with so many edges over the half width of the contact."""
        kind, cell = element.split("-")
        problem = (line if cell == "T6" else sphere)(edges, PLACE)
        new = kind == "pw"
        answer = (pw_t6 if new else snes_vi).solve(problem)
        state = StressState.PLANE_STRAIN if cell == "T6" else StressState.SOLID
        made = (Spaces.petrov_galerkin if new else Spaces.galerkin)(problem.mesh)
        surface = SurfaceNodes.from_body(Body(made, Material(E, NU), state), problem.touching)
        force = problem.forces(answer.u, answer.tested)[surface.node, problem.up]
        return cls(problem, answer.u, surface, force)
