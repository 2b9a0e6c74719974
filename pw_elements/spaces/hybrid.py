"""Spaces of the hybrid element: displacements and a continuous pressure in one mixed space.

The trial functions are Taylor and Hood's pair: quadratic displacements (P2 or Q2) and a continuous
linear pressure (P1, or Q1 on quadrilaterals and hexahedra). The test functions are Bercovier and
Pironneau's pair: piecewise-linear weight functions for the displacements and the same functions as
the trial functions for the pressure.
"""

from dataclasses import dataclass
from functools import cached_property

from petsc4py import PETSc

import basix.ufl
import numpy as np
from dolfinx import fem, la
from dolfinx.mesh import MeshTags

from pw_elements._compat import matrix_with_single_entry_rows
from pw_elements.arrays import Array, LocalIndices, Mask
from pw_elements.checks import (
    JoinedSpace,
    count_local_and_global_dofs,
    raise_errors_on_all_processes,
)

# Effect of a constant pressure, relative to the norm of the stiffness, that may be due to round-off
CONSTANT_PRESSURE_ROUND_OFF_OVER_STIFFNESS = 1e-10


def displacement_pressure_element(
    displacement_element: basix.ufl._ElementBase, discontinuous_pressure: bool = False
) -> basix.ufl._ElementBase:
    """Create the mixed element of a displacement element and a pressure of degree 1.

    Args:
        displacement_element: vector element of the displacements.
        discontinuous_pressure: whether the pressure is discontinuous between cells;
            `pressure_continuity_matrix` makes such a pressure continuous within each part of a
            body.
    """
    cell = displacement_element.cell_type.name
    pressure = basix.ufl.element("Lagrange", cell, 1, discontinuous=discontinuous_pressure)
    return basix.ufl.mixed_element([displacement_element, pressure])


def is_hybrid(space: fem.FunctionSpace | JoinedSpace) -> bool:
    """Return whether each function of a space consists of a displacement and a pressure."""
    if isinstance(space, JoinedSpace):
        return False  # several hybrid bodies are refused
    element = space.ufl_element()
    if not isinstance(element, basix.ufl._MixedElement) or element.num_sub_elements != 2:
        return False
    vector, scalar = (part.reference_value_shape for part in element.sub_elements)
    return len(vector) == 1 and scalar == ()


def has_discontinuous_pressure(space: fem.FunctionSpace) -> bool:
    """Return whether a space has a pressure that is discontinuous between cells.

    `pressure_continuity_matrix` makes such a pressure continuous within each part of a body.
    """
    return is_hybrid(space) and bool(space.ufl_element().sub_elements[1].discontinuous)


@dataclass(frozen=True)
class SubSpace:
    """Space of one field of a mixed space, and the numbers of its unknowns in the mixed space.

    Args:
        space: space of the field alone.
        unknowns: local numbers (nodes, components) of the field's unknowns among all unknowns of
            the mixed space, including ghosts.
        full_sizes: local and global size of vectors of all unknowns.
    """

    space: fem.FunctionSpace
    unknowns: LocalIndices
    full_sizes: tuple[int, int]

    @classmethod
    def displacements(cls, space: fem.FunctionSpace) -> "SubSpace":
        """Return the sub-space of the displacements, or the whole space if it is not hybrid."""
        if is_hybrid(space):
            return cls._from_field(space, 0)
        index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
        nodes = index_map.size_local + index_map.num_ghosts
        numbers = np.arange(nodes * block, dtype=np.int32).reshape(nodes, block)
        return cls(space, numbers, count_local_and_global_dofs(space))

    @classmethod
    def pressure(cls, space: fem.FunctionSpace) -> "SubSpace":
        return cls._from_field(space, 1)

    @classmethod
    def _from_field(cls, space: fem.FunctionSpace, field_number: int) -> "SubSpace":
        field = fem.functionspace(space.mesh, space.ufl_element().sub_elements[field_number])
        index_map, block = field.dofmap.index_map, field.dofmap.index_map_bs
        unknowns = np.zeros((index_map.size_local + index_map.num_ghosts, block), dtype=np.int32)
        cells = space.sub(field_number).dofmap.list
        unknowns[field.dofmap.list.ravel()] = cells.reshape(-1, block)
        return cls(field, unknowns, count_local_and_global_dofs(space))

    @property
    def local_and_global_size(self) -> tuple[int, int]:
        """Local and global size of vectors of the field."""
        return count_local_and_global_dofs(self.space)

    @cached_property
    def is_whole_space(self) -> bool:
        return self.local_and_global_size == self.full_sizes

    @property
    def owned_unknowns(self) -> LocalIndices:
        """Unknowns (owned nodes, components) of the nodes that this process owns."""
        return self.unknowns[: self.space.dofmap.index_map.size_local]

    def extract(self, all_values: PETSc.Vec) -> PETSc.Vec:
        """Extract the vector of the field's entries from a vector of all unknowns.

        Both vectors get a reference to the space. It keeps the communicator of the mesh alive,
        which copies of the PETSc vectors need.
        """
        part = all_values
        if not self.is_whole_space:
            part = PETSc.Vec().createMPI(self.local_and_global_size, comm=all_values.comm)
            part.setArray(all_values.array_r[self.owned_unknowns.ravel()])
        for vector in (all_values, part):
            vector.setAttr("space", self.space)
        return part

    def embed(self, field_values: Array) -> Array:
        """Return a local array of all unknowns, with the field's values and zeros elsewhere."""
        full = np.zeros(self.full_sizes[0])
        full[self.owned_unknowns.ravel()] = field_values
        return full

    def global_numbers(self) -> PETSc.IS:
        """Return the global numbers, in the mixed space, of the field's owned unknowns."""
        comm = self.space.mesh.comm
        offset = comm.scan(self.full_sizes[0]) - self.full_sizes[0]
        numbers = (self.owned_unknowns.ravel() + offset).astype(PETSc.IntType)
        return PETSc.IS().createGeneral(numbers, comm=comm)

    def extraction_matrix(self) -> PETSc.Mat:
        """Return the matrix (n_field, n) of ones and zeros that extracts the field's unknowns.

        Its product with a vector of all unknowns is the vector that `extract` returns.
        """
        columns = self.global_numbers().getIndices()
        return matrix_with_single_entry_rows(
            columns, (self.local_and_global_size, self.full_sizes), self.space.mesh.comm
        )


def pressure_equilibration_scales(space: fem.FunctionSpace, K: PETSc.Mat) -> PETSc.Vec:
    """Return scales (n,) of the unknowns: 1 for displacements and a modulus for pressures.

    The modulus is the largest diagonal entry of the displacements' stiffness, divided by the norm
    of the block that couples pressures and displacements. A pressure divided by the modulus has the
    magnitude of a displacement.

    Args:
        space: hybrid space; for any other space, all scales are 1.
        K: stiffness matrix (n, n) of the space.
    """
    scale = K.createVecRight()
    scale.set(1.0)
    if not is_hybrid(space):
        return scale
    fields = SubSpace.displacements(space), SubSpace.pressure(space)
    u, p = (field.global_numbers() for field in fields)
    largest = PETSc.NormType.INFINITY
    coupling = K.createSubMatrix(p, u).norm(largest)
    stiffness = fields[0].extract(K.getDiagonal()).norm(largest)
    modulus = stiffness / (coupling or 1.0) or 1.0
    scale.setArray(1.0 + (modulus - 1.0) * fields[1].embed(np.ones(len(fields[1].owned_unknowns))))
    return scale


def list_fields(space: fem.FunctionSpace) -> list[SubSpace]:
    """Return the sub-spaces of displacements and, if the space is hybrid, of pressures."""
    fields = [SubSpace.displacements(space)]
    return [*fields, SubSpace.pressure(space)] if is_hybrid(space) else fields


def pressure_continuity_matrix(
    space: fem.FunctionSpace, parts: MeshTags | None, free: Mask
) -> PETSc.Mat:
    """Assemble the matrix (n, n_r) that makes a discontinuous pressure continuous within each part.

    There is a column for each free displacement, and a column for each pair of a vertex and a part
    that has cells at this vertex. A pair has no column if the pressure at the vertex is prescribed
    in one of these cells.

    Args:
        space: hybrid space with a pressure that is discontinuous between cells.
        parts: tags of all cells, one tag for each part of the body.
        free: mask (owned unknowns,), False for unknowns with a prescribed value.

    Raises:
        ValueError: if `parts` is None or does not contain the tags of all cells.
    """
    mesh = space.mesh
    comm, owned = mesh.comm, mesh.topology.index_map(mesh.topology.dim).size_local
    with raise_errors_on_all_processes(comm):
        if parts is None:
            raise ValueError(
                "the pressure of this space is split: Reduction.dirichlet needs both spaces, "
                "Reduction.dirichlet(body.spaces, conditions)"
            )
        if parts.dim != mesh.topology.dim or np.sum(parts.indices < owned) < owned:
            raise ValueError("parts: the tags have to be those of cells, and of all of them")
    displacements = SubSpace.displacements(space).owned_unknowns.ravel()
    free_displacements = np.sort(displacements[free[displacements]])
    tags = np.unique(np.concatenate(comm.allgather(np.unique(parts.values))))
    part, is_owned = np.empty((owned, 1), dtype=np.intp), parts.indices < owned
    part[parts.indices[is_owned], 0] = np.searchsorted(tags, parts.values[is_owned])
    field, vertices = SubSpace.pressure(space), fem.functionspace(mesh, ("Lagrange", 1)).dofmap
    rows = field.unknowns[field.space.dofmap.list[:owned], 0]
    corners = vertices.list[:owned]
    # for each vertex and part: number of cells, and number of cells in which the pressure at the
    # vertex is prescribed
    counts = la.vector(vertices.index_map, 2 * len(tags))
    counts.array[:] = 0.0
    by_part = counts.array.reshape(-1, len(tags), 2)
    np.add.at(by_part[..., 0], (corners, part), 1.0)
    np.add.at(by_part[..., 1], (corners, part), np.where(free[rows], 0.0, 1.0))
    counts.scatter_reverse(la.InsertMode.add)
    cells, prescribing = np.moveaxis(by_part[: vertices.index_map.size_local], 2, 0)
    is_unknown = ((cells > 0) & (prescribing == 0)).T
    n_columns = len(free_displacements) + int(is_unknown.sum())
    offset = comm.scan(n_columns) - n_columns
    numbers = offset + len(free_displacements) - 1
    numbers = numbers + np.cumsum(is_unknown).reshape(is_unknown.shape)
    cells[:] = np.where(is_unknown, numbers, -1).T  # overwrite the counts by column numbers
    counts.scatter_forward()
    column = np.full(len(free), -1, dtype=np.int64)
    column[free_displacements] = offset + np.arange(len(free_displacements))
    column[rows] = by_part[corners, part, 0].astype(np.int64)
    return matrix_with_single_entry_rows(
        column, (field.full_sizes, (n_columns, PETSc.DETERMINE)), comm
    )
