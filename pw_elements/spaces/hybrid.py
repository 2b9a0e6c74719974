"""Spaces of the hybrid element: displacements and a continuous pressure in one mixed space.

Taylor and Hood's pair, u in P2 and p in P1 (Q1 on quadrilaterals and hexahedra), is weighted by
Bercovier and Pironneau's: piecewise-linear weights beside the same P1.
"""

from dataclasses import dataclass
from functools import cached_property

from petsc4py import PETSc

import basix.ufl
import numpy as np
from dolfinx import fem, la
from dolfinx.mesh import MeshTags

from pw_elements._compat import single_entry_matrix
from pw_elements.arrays import Array, LocalIndices, Mask
from pw_elements.checks import collective_errors, vector_sizes

# What a constant pressure does, over the largest stiffness, that is round-off
PRESSURE_MODE_TOLERANCE = 1e-10


def mixed_element(
    displacement: basix.ufl._ElementBase, split: bool = False
) -> basix.ufl._ElementBase:
    """A vector element and, beside it, a pressure of degree 1, continuous or to be tied."""
    cell = displacement.cell_type.name
    pressure = basix.ufl.element("Lagrange", cell, 1, discontinuous=split)
    return basix.ufl.mixed_element([displacement, pressure])


def is_hybrid(space: fem.FunctionSpace) -> bool:
    """Whether its functions are displacements and a pressure."""
    element = space.ufl_element()
    if not isinstance(element, basix.ufl._MixedElement) or element.num_sub_elements != 2:
        return False
    vector, scalar = (part.reference_value_shape for part in element.sub_elements)
    return len(vector) == 1 and scalar == ()


def has_split_pressure(space: fem.FunctionSpace) -> bool:
    """Whether the pressure is discontinuous between cells, and has to be tied within parts."""
    return is_hybrid(space) and bool(space.ufl_element().sub_elements[1].discontinuous)


@dataclass(frozen=True)
class SubSpace:
    """A field of its own space among the unknowns of a space, owned by the same processes."""

    space: fem.FunctionSpace
    unknowns: LocalIndices  # (nodes, components), local numbers among the unknowns, ghosts too
    full_sizes: tuple[int, int]  # sizes of vectors of unknowns, own and global

    @classmethod
    def displacements(cls, space: fem.FunctionSpace) -> "SubSpace":
        """The displacements of a space: all of it, or of a hybrid one the first field."""
        if is_hybrid(space):
            return cls._of(space, 0)
        index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
        nodes = index_map.size_local + index_map.num_ghosts
        numbers = np.arange(nodes * block, dtype=np.int32).reshape(nodes, block)
        return cls(space, numbers, vector_sizes(space))

    @classmethod
    def pressure(cls, space: fem.FunctionSpace) -> "SubSpace":
        return cls._of(space, 1)

    @classmethod
    def _of(cls, space: fem.FunctionSpace, number: int) -> "SubSpace":
        alone = fem.functionspace(space.mesh, space.ufl_element().sub_elements[number])
        index_map, block = alone.dofmap.index_map, alone.dofmap.index_map_bs
        unknowns = np.zeros((index_map.size_local + index_map.num_ghosts, block), dtype=np.int32)
        cells = space.sub(number).dofmap.list
        unknowns[alone.dofmap.list.ravel()] = cells.reshape(-1, block)
        return cls(alone, unknowns, vector_sizes(space))

    @property
    def sizes(self) -> tuple[int, int]:
        return vector_sizes(self.space)

    @cached_property
    def is_whole_space(self) -> bool:
        return self.sizes == self.full_sizes

    @property
    def owned_unknowns(self) -> LocalIndices:
        """(owned nodes, components), those of the nodes that this process owns."""
        return self.unknowns[: self.space.dofmap.index_map.size_local]

    def extract(self, values: PETSc.Vec) -> PETSc.Vec:
        """The field's entries of a vector of all unknowns; both vectors keep the space alive.

        PETSc's vectors outlive a mesh, but not its communicator, by which their copies are made.
        """
        own = values
        if not self.is_whole_space:
            own = PETSc.Vec().createMPI(self.sizes, comm=values.comm)
            own.setArray(values.array_r[self.owned_unknowns.ravel()])
        for vector in (values, own):
            vector.setAttr("space", self.space)
        return own

    def embed(self, values: Array) -> Array:
        """Values of this process among those of its unknowns, all others being zero."""
        every = np.zeros(self.full_sizes[0])
        every[self.owned_unknowns.ravel()] = values
        return every

    def global_numbers(self) -> PETSc.IS:
        """Global numbers of the field's unknowns of this process, among all."""
        comm = self.space.mesh.comm
        first = comm.scan(self.full_sizes[0]) - self.full_sizes[0]
        numbers = (self.owned_unknowns.ravel() + first).astype(PETSc.IntType)
        return PETSc.IS().createGeneral(numbers, comm=comm)

    def selection_matrix(self) -> PETSc.Mat:
        """Matrix (field's, unknowns) of ones that does what `part` does."""
        columns = self.global_numbers().getIndices()
        return single_entry_matrix(columns, (self.sizes, self.full_sizes), self.space.mesh.comm)


def equilibration_scale(space: fem.FunctionSpace, K: PETSc.Mat) -> PETSc.Vec:
    """Scale (n,): 1 at displacements, a stiffness per area at pressures; p / scale is a length."""
    scale = K.createVecRight()
    scale.set(1.0)
    if not is_hybrid(space):
        return scale
    fields = SubSpace.displacements(space), SubSpace.pressure(space)
    u, p = (field.global_numbers() for field in fields)
    largest = PETSc.NormType.INFINITY
    of_volume = K.createSubMatrix(p, u).norm(largest)
    of_equilibrium = fields[0].extract(K.getDiagonal()).norm(largest)
    modulus = of_equilibrium / (of_volume or 1.0) or 1.0
    scale.setArray(1.0 + (modulus - 1.0) * fields[1].embed(np.ones(len(fields[1].owned_unknowns))))
    return scale


def list_fields(space: fem.FunctionSpace) -> list[SubSpace]:
    """The displacements (or whatever a space that is not hybrid has), and the pressure."""
    fields = [SubSpace.displacements(space)]
    return [*fields, SubSpace.pressure(space)] if is_hybrid(space) else fields


def tie_pressures(space: fem.FunctionSpace, parts: MeshTags | None, free: Mask) -> PETSc.Mat:
    """Selection (n, n_r) of free unknowns that gives a vertex one pressure in each part."""
    mesh = space.mesh
    comm, owned = mesh.comm, mesh.topology.index_map(mesh.topology.dim).size_local
    with collective_errors(comm):
        if parts is None:
            raise ValueError(
                "the pressure of this space is split: Reduction.dirichlet needs both spaces, "
                "Reduction.dirichlet(body.spaces, conditions)"
            )
        if parts.dim != mesh.topology.dim or np.sum(parts.indices < owned) < owned:
            raise ValueError("parts: the tags have to be those of cells, and of all of them")
    displacements = SubSpace.displacements(space).owned_unknowns.ravel()
    moved = np.sort(displacements[free[displacements]])
    values = np.unique(np.concatenate(comm.allgather(np.unique(parts.values))))
    part, own = np.empty((owned, 1), dtype=np.intp), parts.indices < owned
    part[parts.indices[own], 0] = np.searchsorted(values, parts.values[own])
    field, vertices = SubSpace.pressure(space), fem.functionspace(mesh, ("Lagrange", 1)).dofmap
    rows = field.unknowns[field.space.dofmap.list[:owned], 0]
    corners = vertices.list[:owned]
    # how many cells of a part a vertex has, and how many of them prescribe its pressure
    found = la.vector(vertices.index_map, 2 * len(values))
    found.array[:] = 0.0
    sums = found.array.reshape(-1, len(values), 2)
    np.add.at(sums[..., 0], (corners, part), 1.0)
    np.add.at(sums[..., 1], (corners, part), np.where(free[rows], 0.0, 1.0))
    found.scatter_reverse(la.InsertMode.add)
    cells, held = np.moveaxis(sums[: vertices.index_map.size_local], 2, 0)
    kept = ((cells > 0) & (held == 0)).T
    count = len(moved) + int(kept.sum())
    first = comm.scan(count) - count
    numbers = first + len(moved) - 1 + np.cumsum(kept).reshape(kept.shape)
    cells[:] = np.where(kept, numbers, -1).T
    found.scatter_forward()
    column = np.full(len(free), -1, dtype=np.int64)
    column[moved] = first + np.arange(len(moved))
    column[rows] = sums[corners, part, 0].astype(np.int64)
    return single_entry_matrix(column, (field.full_sizes, (count, PETSc.DETERMINE)), comm)
