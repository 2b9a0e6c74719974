"""Residuals of several bodies with a mesh each, joined to one system of equations."""

from collections.abc import Sequence
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem

from pw_elements.algebra.nonlinear import PetrovGalerkinProblem, ResidualSystem
from pw_elements.algebra.reduction import sort_conditions_by_body
from pw_elements.checks import (
    JoinedFunction,
    arguments,
    count_local_and_global_dofs,
    raise_errors_on_all_processes,
)
from pw_elements.spaces import AssemblyRecord, is_hybrid, read_record


class JoinedResidualSystem:
    """Residuals and tangents of several bodies, which do not depend on each other.

    Args:
        u: displacements of all bodies.
        systems: residuals and tangents of the bodies.
    """

    def __init__(self, u: JoinedFunction, systems: Sequence[ResidualSystem]) -> None:
        self.u, self._systems = u, list(systems)
        self.blocked = False

    @cached_property
    def tangent(self) -> PETSc.Mat:
        """Tangent (n, n) of all bodies; it is assembled by `assemble_tangent`."""
        tangents = [system.tangent for system in self._systems]
        for tangent in tangents:
            tangent.assemble()
        states = frozenset().union(*(read_record(tangent).stress_states for tangent in tangents))
        joined = self._nested_tangent.convert("aij", PETSc.Mat())
        return AssemblyRecord(stress_states=states).attach(joined)

    @cached_property
    def _nested_tangent(self) -> PETSc.Mat:
        n = len(self._systems)
        blocks: list[list[PETSc.Mat | None]] = [[None] * n for _ in range(n)]
        for k, system in enumerate(self._systems):
            blocks[k][k] = system.tangent
        return PETSc.Mat().createNest(blocks, comm=self.u.function_space.mesh.comm)

    def set_unknowns(self, x: PETSc.Vec) -> None:
        """Set the displacements of all bodies, including ghosts, to x (n,); collective."""
        self.u.x.array[: x.getLocalSize()] = x.array_r
        self.u.x.scatter_forward()
        self.u.copy_to_parts()

    def assemble_residual(self) -> PETSc.Vec:
        """Return the residuals (n,) of all bodies at their displacements; collective."""
        self.u.copy_to_parts()
        space = self.u.function_space
        forces = PETSc.Vec().createMPI(count_local_and_global_dofs(space), comm=space.mesh.comm)
        parts = [system.assemble_residual() for system in self._systems]
        forces.setArray(np.concatenate([part.array_r for part in parts]))
        return forces

    def assemble_tangent(self) -> None:
        """Assemble the tangents of all bodies at their displacements; collective."""
        self.u.copy_to_parts()
        for system in self._systems:
            system.assemble_tangent()
        self._nested_tangent.convert("aij", self.tangent)


class JoinedProblem:
    """Residuals of several bodies with a mesh each, whose displacements are solved together.

    Args:
        residuals: residual of each body, as in `PetrovGalerkinProblem`.
        functions: displacements of each body.
        conditions: Dirichlet conditions on the spaces of the bodies.

    Attributes:
        u: displacements of all bodies.
        parts: problem of each body.
        system: joined residuals and tangents.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for residuals and functions that do not define a problem: not as many of both,
            several functions on one mesh, meshes of different dimensions or on different processes,
            or bodies with a pressure.
    """

    def __init__(
        self,
        residuals: Sequence[ufl.Form],
        functions: Sequence[fem.Function],
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
    ) -> None:
        _check_functions_of_bodies(residuals, functions)
        self.u = JoinedFunction(functions)
        sorted_conditions = sort_conditions_by_body(self.u.function_space, conditions)
        self.parts = [
            PetrovGalerkinProblem(*arguments_of_body)
            for arguments_of_body in zip(residuals, functions, sorted_conditions, strict=True)
        ]
        self.system = JoinedResidualSystem(self.u, [part.system for part in self.parts])


def _check_functions_of_bodies(
    residuals: Sequence[ufl.Form], functions: Sequence[fem.Function]
) -> None:
    with raise_errors_on_all_processes(arguments.find_largest_communicator(*functions)):
        if len(residuals) != len(functions):
            raise ValueError(
                f"there are {len(residuals)} residuals and {len(functions)} unknown functions: "
                "give one of each for every body"
            )
        for u in functions:
            arguments.check_type("u", u, fem.Function, "give one function for each body")
            arguments.check_function_space(u.function_space)
        spaces = [u.function_space for u in functions]
        meshes = [space.mesh for space in spaces]
        if len({id(mesh) for mesh in meshes}) < len(meshes):
            raise ValueError(
                "two unknown functions are on one mesh: bodies in one mesh have one residual"
            )
        if any(map(is_hybrid, spaces)):
            raise ValueError(
                "a body has a pressure as an unknown: bodies with a mesh each need spaces of "
                "displacements alone, as of Spaces.petrov_galerkin(mesh)"
            )
        if len({(space.mesh.geometry.dim, space.dofmap.index_map_bs) for space in spaces}) > 1:
            raise ValueError("the bodies have different dimensions or numbers of components")
        if any(
            MPI.Comm.Compare(mesh.comm, meshes[0].comm) not in (MPI.IDENT, MPI.CONGRUENT)
            for mesh in meshes
        ):
            raise ValueError("the meshes of the bodies are on different processes")


def make_residual_problem(
    residual: ufl.Form | Sequence[ufl.Form],
    u: fem.Function | Sequence[fem.Function],
    conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
) -> PetrovGalerkinProblem | JoinedProblem:
    """Return the problem of one residual, or of a residual for each of several bodies."""
    if isinstance(residual, list | tuple) and isinstance(u, list | tuple):
        return JoinedProblem(residual, u, conditions)
    return PetrovGalerkinProblem(residual, u, conditions)
