"""Trial and test spaces with one numbering: node i of the one is node i of the other.

Displacements are u = N a, Eq. (3), virtual displacements v = W c, Eq. (7).
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

from pw_elements.checks import arguments, check_same_arguments, collective_errors
from pw_elements.spaces.elements import macro_element, quadratic_element
from pw_elements.spaces.hybrid import SubSpace, has_split_pressure, is_hybrid, mixed_element


class NumberingError(RuntimeError):
    """Trial and test space number their nodes differently."""


@dataclass(frozen=True)
class Spaces:
    """A trial and a test space on one mesh, with identical dofmaps.

        spaces = Spaces.petrov_galerkin(mesh)  # displacements; components=0 for a temperature
        u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)

    Args:
        trial: of the unknowns: displacements, or these and a pressure, or a scalar field.
        test: of their weight functions; the trial space itself in Galerkin's method.
        parts: tags of all cells; the pressure of a hybrid body is split between them.

    Raises:
        NumberingError: if the two spaces number their nodes differently.
    """

    trial: fem.FunctionSpace
    test: fem.FunctionSpace
    parts: MeshTags | None = None

    @check_same_arguments
    def __post_init__(self) -> None:
        arguments.check_space(self.trial, "the trial space")
        arguments.check_space(self.test, "the test space")
        with collective_errors(self.trial.mesh.comm):
            check_part_tags(self.parts)
            if self.parts and self.parts.topology != self.mesh.topology._cpp_object:
                raise ValueError("parts: the tags are those of another mesh")
        _assert_one_numbering(self.trial, self.test)

    @classmethod
    @check_same_arguments
    def petrov_galerkin(cls, mesh: Mesh, components: int | None = None) -> "Spaces":
        """Quadratic trial, piecewise-linear test functions: the paper's element.

        Args:
            mesh: of intervals, triangles, quadrilaterals, tetrahedra or hexahedra.
            components: of the vector field; by default the mesh's dimension; 0 for a scalar.
        """
        trial = fem.functionspace(mesh, _trial_element(mesh, components))
        return cls(trial, test_space(trial))

    @classmethod
    @check_same_arguments
    def galerkin(cls, mesh: Mesh, components: int | None = None) -> "Spaces":
        """Quadratic Lagrange functions for both: the standard element (CPS6 on triangles).

        Args:
            mesh: of intervals, triangles, quadrilaterals, tetrahedra or hexahedra.
            components: of the vector field, by default the mesh's dimension; 0 for a scalar.
        """
        trial = fem.functionspace(mesh, _trial_element(mesh, components))
        return cls(trial, trial)

    @classmethod
    @check_same_arguments
    def hybrid(cls, mesh: Mesh, parts: MeshTags | None = None) -> "Spaces":
        """Displacements and a continuous pressure of degree 1, for nearly incompressible bodies.

        Displacements are those of `petrov_galerkin`; the pressure is its own test space. Nothing
        locks up to and including nu = 1/2. `Body` makes the forms, with one vector (n,) of all
        unknowns; `split` separates displacement and pressure.

        Args:
            mesh: of triangles, quadrilaterals, tetrahedra or hexahedra.
            parts: tags of all cells, one for each material. The pressure may jump between them;
                `Reduction.dirichlet(spaces, conditions)` makes it continuous within each. Without
                them the pressure is off by ten per cent and more where materials meet.
        """
        element = mixed_element(_trial_element(mesh), split=parts is not None)
        trial = fem.functionspace(mesh, element)
        return cls(trial, test_space(trial), parts)

    @property
    def mesh(self) -> Mesh:
        """The mesh of both spaces."""
        return self.trial.mesh

    @property
    def displacements(self) -> "Spaces":
        """The spaces of the displacements alone; the same unless these are hybrid."""
        if not self.is_hybrid:
            return self
        trial = SubSpace.displacements(self.trial).space
        if self.test is self.trial:
            return Spaces(trial, trial)
        return Spaces(trial, SubSpace.displacements(self.test).space)

    @property
    def is_hybrid(self) -> bool:
        """Whether there is a pressure in addition to the displacements."""
        return is_hybrid(self.trial)


@check_same_arguments
def test_space(trial: fem.FunctionSpace) -> fem.FunctionSpace:
    """Piecewise-linear test functions for your own quadratic Lagrange space.

    Use it as `v = ufl.TestFunction(test_space(U))` together with `u = ufl.TrialFunction(U)`; an
    assembled row i then belongs to the node of column i. For tetrahedra see `macro_element`. In
    Taylor and Hood's mixed space only the displacements get other test functions.

    Args:
        trial: quadratic Lagrange space, scalar or with components, of any cell.

    Raises:
        ValueError: if `trial` is not a (blocked) Lagrange space of degree 2, nor one of these and
            a pressure of degree 1.
        NumberingError: if DOLFINx numbers the two spaces differently.
    """
    arguments.check_space(trial, "the trial space")
    mesh = trial.mesh
    cell = mesh.topology.cell_name()
    whole = trial.ufl_element()
    hybrid = is_hybrid(trial)
    shape = tuple((whole.sub_elements[0] if hybrid else whole).reference_value_shape)
    quadratic, weights = quadratic_element(cell, shape), macro_element(cell, shape)
    if hybrid:
        split = has_split_pressure(trial)
        quadratic, weights = (mixed_element(vector, split) for vector in (quadratic, weights))
    if whole != quadratic:
        raise ValueError(
            f"the trial space has the element {whole}; piecewise-linear test functions go with "
            f'("Lagrange", 2) on a {cell}, alone or beside a pressure of degree 1'
        )
    test = fem.functionspace(mesh, weights)
    _assert_one_numbering(trial, test)
    return test


test_space.__test__ = False  # type: ignore[attr-defined]  # no test, whatever pytest thinks


@check_same_arguments
def as_function(
    space: fem.FunctionSpace, values: PETSc.Vec, name: str = "f", out: fem.Function | None = None
) -> fem.Function:
    """Turns a vector (n,) in a space's numbering into a function, for forms and files.

        u = as_function(U, solve(K, f, held), "displacement")
        as_function(U, solve(K, 2 * f, held), out=u)  # forms and writers that have u see it

    Args:
        space: that numbers the vector.
        values: vector (n,).
        name: of a new function.
        out: a function of the space to fill, in place of a new one; it keeps its name.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: if the vector does not belong to the space, or the function belongs to another.
    """
    arguments.check_space(space)
    with collective_errors(space.mesh.comm):
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


@check_same_arguments
def split(
    space: fem.FunctionSpace,
    values: PETSc.Vec | Any,  # noqa: ANN401
) -> tuple[fem.Function, fem.Function]:
    """Displacement and pressure, as functions, from a vector or a state of a hybrid body.

    The pressure is compression positive, -lambda div u.

        u, p = split(body.spaces.trial, solve(K, f, held))
        u, p = split(body.spaces.trial, states[-1])

    Args:
        space: trial space of `Spaces.hybrid`.
        values: vector (n,), or a `ContactState`, whose `unknowns` these are.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: if the space is not hybrid, or the vector does not belong to it.
    """
    arguments.check_space(space)
    if not is_hybrid(space):
        raise ValueError("the space has no pressure: Spaces.hybrid(mesh) makes one that has")
    parts = SubSpace.displacements(space), SubSpace.pressure(space)
    given = getattr(values, "unknowns", values)
    moved = parts[0].sizes[1]  # local sizes may be equal on some processes alone
    if isinstance(given, PETSc.Vec) and given.handle and given.getSize() == moved:
        raise ValueError(
            "the vector has displacements alone: split(U, state) has the pressure, too"
        )
    both = as_function(space, given)
    found = []
    for name, part in zip(("displacement", "pressure"), parts, strict=True):
        function = fem.Function(part.space, name=name)
        function.x.array[:] = both.x.array[part.unknowns.ravel()]
        found.append(function)
    return found[0], found[1]


def scalar_space(space: fem.FunctionSpace) -> fem.FunctionSpace:
    """The space of a vector space's components, its nodes numbered like the vectors'."""
    scalars = fem.functionspace(space.mesh, space.ufl_element().sub_elements[0])
    _assert_one_numbering(space, scalars, blocks=False)
    return scalars


def gather_from_owners(
    space: fem.FunctionSpace, nodes: npt.NDArray[np.int64], values: npt.NDArray
) -> npt.NDArray:
    """Rows (k, ...) of global nodes, on all processes, of the owners' values (owned nodes, ...)."""
    own = nodes - space.dofmap.index_map.local_range[0]
    mine = (own >= 0) & (own < len(values))
    found = np.zeros((len(nodes), *values.shape[1:]), dtype=values.dtype)
    found[mine] = values[own[mine]]
    space.mesh.comm.Allreduce(MPI.IN_PLACE, found, MPI.SUM)
    return found


def check_part_tags(parts: object) -> None:
    arguments.check_type("parts", parts, MeshTags | None, "dolfinx.mesh.meshtags makes them")


def _trial_element(mesh: Mesh, components: int | None = None) -> basix.ufl._ElementBase:
    arguments.check_mesh_type(mesh)
    components = mesh.geometry.dim if components is None else components
    count = arguments.check_integer("components", components, 0)
    return quadratic_element(mesh.topology.cell_name(), (count,) if count else ())


def _assert_one_numbering(
    trial: fem.FunctionSpace, test: fem.FunctionSpace, blocks: bool = True
) -> None:
    """DOLFINx nowhere promises that both numberings agree, so it is checked: here alone."""
    a, b = trial.dofmap, test.dofmap
    same = (
        (a.index_map_bs == b.index_map_bs or not blocks)
        and a.index_map.size_local == b.index_map.size_local
        and np.array_equal(a.list, b.list)
        and np.array_equal(a.index_map.ghosts, b.index_map.ghosts)
    )
    if not trial.mesh.comm.allreduce(same, MPI.LAND):
        raise NumberingError(
            "trial and test space number their nodes differently, so nodal equations would be "
            "mixed up: build both on one mesh object, the test space by test_space(trial)"
        )
