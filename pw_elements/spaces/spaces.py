"""Trial and test spaces with the same numbering of nodes.

Displacements are u = N a, Eq. (3), with quadratic shape functions N and nodal displacements a.
Virtual displacements are v = W c, Eq. (7), with weight functions W and nodal values c.
"""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh, MeshTags

from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.spaces.elements import piecewise_linear_sub_cell_element, quadratic_element
from pw_elements.spaces.hybrid import (
    SubSpace,
    displacement_pressure_element,
    has_discontinuous_pressure,
    is_hybrid,
)


class DifferentNodeNumbering(RuntimeError):
    """Error raised if the trial space and the test space number their nodes differently."""


@dataclass(frozen=True)
class Spaces:
    """Trial and test space on one mesh, with the same numbering of nodes.

        spaces = Spaces.petrov_galerkin(mesh)  # displacements; components=0 for a temperature
        u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)

    Args:
        trial: space of the unknowns: displacements, displacements and a pressure, or a scalar.
        test: space of the weight functions; in Galerkin's method it is the trial space itself.
        parts: for hybrid spaces, tags of all cells. The pressure may jump between cells with
            different tags. If None, the pressure is continuous.

    Raises:
        DifferentNodeNumbering: if the two spaces number their nodes differently.
    """

    trial: fem.FunctionSpace
    test: fem.FunctionSpace
    parts: MeshTags | None = None

    @check_same_arguments_on_all_processes
    def __post_init__(self) -> None:
        arguments.check_function_space(self.trial, "the trial space")
        arguments.check_function_space(self.test, "the test space")
        with raise_errors_on_all_processes(self.trial.mesh.comm):
            check_part_tags_type(self.parts)
            if self.parts and self.parts.topology != self.mesh.topology._cpp_object:
                raise ValueError("parts: the tags are those of another mesh")
        _check_same_numbering(self.trial, self.test)

    @classmethod
    @check_same_arguments_on_all_processes
    def petrov_galerkin(cls, mesh: Mesh, components: int | None = None) -> "Spaces":
        """Create spaces of quadratic trial and piecewise-linear test functions, as in the paper.

        Args:
            mesh: mesh of intervals, triangles, quadrilaterals, tetrahedra or hexahedra.
            components: number of components of a vector field, or 0 for a scalar field; by default
                the dimension of the mesh.
        """
        trial = fem.functionspace(mesh, _quadratic_trial_element(mesh, components))
        return cls(trial, test_space(trial))

    @classmethod
    @check_same_arguments_on_all_processes
    def galerkin(cls, mesh: Mesh, components: int | None = None) -> "Spaces":
        """Create spaces of the standard element: quadratic functions for both trial and test.

        On triangles it is the element that Abaqus calls CPS6.

        Args:
            mesh: mesh of intervals, triangles, quadrilaterals, tetrahedra or hexahedra.
            components: number of components of a vector field, or 0 for a scalar field; by default
                the dimension of the mesh.
        """
        trial = fem.functionspace(mesh, _quadratic_trial_element(mesh, components))
        return cls(trial, trial)

    @classmethod
    @check_same_arguments_on_all_processes
    def hybrid(cls, mesh: Mesh, parts: MeshTags | None = None) -> "Spaces":
        """Create spaces of displacements and a pressure, for nearly incompressible bodies.

        The displacements have the trial and test functions of `petrov_galerkin`. The pressure is
        continuous and of degree 1, with equal trial and test functions. The element does not lock
        for Poisson's ratios up to and including 1/2. `Body` creates the forms, whose unknowns are
        in a single vector (n,); `split` extracts displacement and pressure from it.

        Args:
            mesh: mesh of triangles, quadrilaterals, tetrahedra or hexahedra.
            parts: tags of all cells, one tag for each material. The pressure may jump between cells
                with different tags; `Reduction.dirichlet(spaces, conditions)` makes it continuous
                within each part. Without `parts`, results are wrong by ten per cent and more
                where different materials meet.
        """
        element = displacement_pressure_element(
            _quadratic_trial_element(mesh), discontinuous_pressure=parts is not None
        )
        trial = fem.functionspace(mesh, element)
        return cls(trial, test_space(trial), parts)

    @property
    def mesh(self) -> Mesh:
        """Mesh of both spaces."""
        return self.trial.mesh

    @property
    def displacements(self) -> "Spaces":
        """Spaces of the displacements without the pressure; this object if there is no pressure."""
        if not self.is_hybrid:
            return self
        trial = SubSpace.displacements(self.trial).space
        if self.test is self.trial:
            return Spaces(trial, trial)
        return Spaces(trial, SubSpace.displacements(self.test).space)

    @property
    def is_hybrid(self) -> bool:
        """Whether the spaces have a pressure in addition to the displacements."""
        return is_hybrid(self.trial)


@check_same_arguments_on_all_processes
def test_space(trial: fem.FunctionSpace) -> fem.FunctionSpace:
    """Create the piecewise-linear test space of a quadratic Lagrange space.

    Use `v = ufl.TestFunction(test_space(U))` together with `u = ufl.TrialFunction(U)`; row i of an
    assembled matrix then belongs to the same node as column i. For tetrahedra, see
    `piecewise_linear_sub_cell_element`. In a mixed space of displacements and a pressure (Taylor
    and Hood's), only the displacements get piecewise-linear test functions.

    Args:
        trial: quadratic Lagrange space on any type of cell, scalar or with components; or a mixed
            space of such displacements and a pressure of degree 1.

    Raises:
        ValueError: if `trial` is any other space.
        DifferentNodeNumbering: if DOLFINx numbers the two spaces differently.
    """
    arguments.check_function_space(trial, "the trial space")
    mesh = trial.mesh
    cell = mesh.topology.cell_name()
    element = trial.ufl_element()
    hybrid = is_hybrid(trial)
    shape = tuple((element.sub_elements[0] if hybrid else element).reference_value_shape)
    quadratic, weights = (
        quadratic_element(cell, shape),
        piecewise_linear_sub_cell_element(cell, shape),
    )
    if hybrid:
        split = has_discontinuous_pressure(trial)
        quadratic, weights = (
            displacement_pressure_element(vector, split) for vector in (quadratic, weights)
        )
    if element != quadratic:
        raise ValueError(
            f"the trial space has the element {element}; piecewise-linear test functions go with "
            f'("Lagrange", 2) on a {cell}, alone or beside a pressure of degree 1'
        )
    test = fem.functionspace(mesh, weights)
    _check_same_numbering(trial, test)
    return test


test_space.__test__ = False  # type: ignore[attr-defined]  # pytest would collect it as a test


@check_same_arguments_on_all_processes
def as_function(
    space: fem.FunctionSpace, values: PETSc.Vec, name: str = "f", out: fem.Function | None = None
) -> fem.Function:
    """Convert a vector (n,) of nodal values into a function of a space, for forms and files.

        u = as_function(U, solve(K, f, held), "displacement")
        as_function(U, solve(K, 2 * f, held), out=u)  # updates u in forms and writers

    Args:
        space: space of the function.
        values: vector (n,) in the numbering of the space.
        name: name of the new function.
        out: existing function of the space to be filled; it keeps its name. If None, a new function
            is created.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: if the vector or the function `out` does not belong to the space.
    """
    arguments.check_function_space(space)
    with raise_errors_on_all_processes(space.mesh.comm):
        arguments.check_type("name", name, str, "it has to be a string")
        arguments.check_petsc_vector("the vector", values, "the space", space)
        if out is not None:
            arguments.check_type("out", out, fem.Function, "it has to be a function of the space")
            if out.function_space != space:
                raise ValueError("the function to fill belongs to another space")
    function = fem.Function(space, name=name) if out is None else out
    function.x.array[: values.getLocalSize()] = values.array_r
    function.x.scatter_forward()
    return function


@check_same_arguments_on_all_processes
def split(
    space: fem.FunctionSpace,
    values: PETSc.Vec | Any,  # noqa: ANN401
) -> tuple[fem.Function, fem.Function]:
    """Extract the displacement and pressure functions from a vector or state of a hybrid body.

    The pressure is -lambda div u, with Lamé's constant lambda. It is positive in compression.

        u, p = split(body.spaces.trial, solve(K, f, held))
        u, p = split(body.spaces.trial, states[-1])

    Args:
        space: trial space of `Spaces.hybrid`.
        values: vector (n,) of all unknowns, or a `ContactState`, whose `unknowns` are used.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: if the space is not hybrid, or the vector does not belong to it.
    """
    arguments.check_function_space(space)
    if not is_hybrid(space):
        raise ValueError("the space has no pressure: Spaces.hybrid(mesh) makes one that has")
    fields = SubSpace.displacements(space), SubSpace.pressure(space)
    vector = getattr(values, "unknowns", values)
    n_displacements = fields[0].local_and_global_size[
        1
    ]  # global, as local sizes may agree on some processes
    if isinstance(vector, PETSc.Vec) and vector.handle and vector.getSize() == n_displacements:
        raise ValueError(
            "the vector has displacements alone: split(U, state) has the pressure, too"
        )
    mixed = as_function(space, vector)
    functions = []
    for name, field in zip(("displacement", "pressure"), fields, strict=True):
        function = fem.Function(field.space, name=name)
        function.x.array[:] = mixed.x.array[field.unknowns.ravel()]
        functions.append(function)
    return functions[0], functions[1]


def scalar_component_space(space: fem.FunctionSpace) -> fem.FunctionSpace:
    """Create the scalar space of one component of a vector space, with the same node numbers."""
    scalars = fem.functionspace(space.mesh, space.ufl_element().sub_elements[0])
    _check_same_numbering(space, scalars, compare_components=False)
    return scalars


def gather_nodal_values(
    space: fem.FunctionSpace, global_nodes: npt.NDArray[np.int64], owned_values: npt.NDArray
) -> npt.NDArray:
    """Gather nodal values from the processes that own the nodes; collective.

    Args:
        space: space of the nodes.
        global_nodes: global numbers (k,) of the nodes, the same on all processes.
        owned_values: values (owned nodes, ...) at the nodes that this process owns.

    Returns:
        Values (k, ...) at the given nodes, the same on all processes.
    """
    local = global_nodes - space.dofmap.index_map.local_range[0]
    is_owned = (local >= 0) & (local < len(owned_values))
    gathered = np.zeros((len(global_nodes), *owned_values.shape[1:]), dtype=owned_values.dtype)
    gathered[is_owned] = owned_values[local[is_owned]]
    space.mesh.comm.Allreduce(MPI.IN_PLACE, gathered, MPI.SUM)
    return gathered


def check_part_tags_type(parts: object) -> None:
    arguments.check_type("parts", parts, MeshTags | None, "dolfinx.mesh.meshtags makes them")


def _quadratic_trial_element(mesh: Mesh, components: int | None = None) -> basix.ufl._ElementBase:
    arguments.check_double_precision_mesh(mesh)
    components = mesh.geometry.dim if components is None else components
    count = arguments.check_integer("components", components, 0)
    return quadratic_element(mesh.topology.cell_name(), (count,) if count else ())


def _check_same_numbering(
    trial: fem.FunctionSpace, test: fem.FunctionSpace, compare_components: bool = True
) -> None:
    """Raise DifferentNodeNumbering unless both spaces number their nodes in the same way.

    DOLFINx does not guarantee equal numbering, and the library therefore checks all its spaces.

    Args:
        trial: trial space.
        test: test space.
        compare_components: whether both spaces have to have the same number of components.
    """
    a, b = trial.dofmap, test.dofmap
    same = (
        (a.index_map_bs == b.index_map_bs or not compare_components)
        and a.index_map.size_local == b.index_map.size_local
        and np.array_equal(a.list, b.list)
        and np.array_equal(a.index_map.ghosts, b.index_map.ghosts)
    )
    if not trial.mesh.comm.allreduce(same, MPI.LAND):
        raise DifferentNodeNumbering(
            "trial and test space number their nodes differently, so nodal equations would be "
            "mixed up: build both on one mesh object, the test space by test_space(trial)"
        )
