"""Fluxes at the nodes of a boundary where a field is prescribed, from nodal reactions.

Heat, seepage, current: r = K a - f at a prescribed node is what enters the body there, weighted
by the node's test function; over an area it is a flux (of vectors, a traction). It is far more
accurate than the gradient of the solution, and conserves: reactions and sources add up to zero.

Which area? Piecewise-linear weights integrate to the node's geometric share, and reactions are as
even as the flux. A standard quadratic element's are not: over geometric areas they zigzag by a
third (in space corners of tetrahedra get nothing at all), over own weights they do not, where there
is one. T evens them out afterwards, see `recovery.force_transfer`.
"""

from dataclasses import dataclass
from typing import Literal, get_args

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import arguments
from pw_elements.collective import agree, collective
from pw_elements.elements import quadratic_element
from pw_elements.given import is_finite
from pw_elements.mechanics import Scalar
from pw_elements.parts import Part
from pw_elements.recovery import SurfaceNodes, force_transfer
from pw_elements.spaces import Spaces, scalar_space

Array = npt.NDArray[np.float64]
Area = Literal["geometric", "own"]


@dataclass(frozen=True)
class NodalFlux:
    """Fluxes at the nodes of a part of the boundary, the same on every process.

    Args:
        surface: the nodes, their positions, areas, edges and rim.
        reaction: (m,) or (m, components), the flow into the body at each node.
        flux: (m,) or (m, components), the same per area; NaN where a node has no area.
    """

    surface: SurfaceNodes
    reaction: Array
    flux: Array


def nodal_flux(
    spaces: Spaces,
    reactions: PETSc.Vec,
    where: Part,
    area: Area = "geometric",
    evened: bool = False,
    depth: Scalar = 1.0,
) -> NodalFlux:
    """Flux into a body at the nodes of a boundary where its field is prescribed.

        K, f = assemble_matrix(k * inner(grad(u), grad(v)) * dx), assemble_vector(q * v * dx)
        a = solve(K, f, Reduction.dirichlet(spaces.trial, conditions))
        heat = nodal_flux(spaces, reactions(K, a, f), lambda x: np.isclose(x[0], 0.0))
        heat.surface.position, heat.flux

    Where the part ends at another one with prescribed values, the reactions at the nodes on its rim
    belong to both: leave them out (`surface.rim`), or treat both parts as one.

    Args:
        spaces: of the field, scalar or with components.
        reactions: vector (n,), of `reactions` or `PetrovGalerkinProblem.reactions`.
        where: part of the boundary, as in `boundary_measure`.
        area: by which reactions are divided: the node's share of the geometry, or the integral of
            its own test function; with piecewise-linear weights on flat boundaries both agree.
        evened: whether reactions of a standard quadratic element are first evened out by T.
        depth: factor of the lengths or areas of the mesh, such as a thickness or 2 pi r.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for a vector that is not finite or of another space, an unknown area, T with
            another element or own areas, a depth that is not positive, or a part of the
            boundary that is none.
    """
    with collective(arguments.processes(spaces.trial if isinstance(spaces, Spaces) else None)):
        arguments.of_type("spaces", spaces, Spaces, "Spaces.petrov_galerkin(mesh, 0) makes some")
        arguments.petsc_vector("the vector of reactions", reactions)
        sizes = reactions.getSizes()
        arguments.same_sizes("the vector of reactions", sizes, "the space", spaces.trial)
        if area not in get_args(Area):
            raise ValueError(f"area {area!r}: it is 'geometric' or 'own'")
        arguments.flag("evened", evened)
        if evened and (area == "own" or not _standard(spaces)):
            raise ValueError(
                "T evens out reactions of the standard quadratic element, for geometric areas: "
                "other elements and own areas do without"
            )
    space = spaces.trial
    agree(space.mesh.comm, {"area": area, "evened": bool(evened)})
    if not is_finite(reactions):
        raise ValueError("the vector of reactions is not finite")
    if evened:
        reactions = force_transfer(space) * reactions
    surface = SurfaceNodes.scalar(_scalar(spaces), where, depth)
    reaction = _at(reactions, surface.node, space.dofmap.index_map_bs)
    if not space.num_sub_spaces:
        reaction = reaction[:, 0]
    read = surface.pressure if area == "own" else surface.tributary_pressure
    return NodalFlux(surface, reaction, read(reaction))


def _standard(spaces: Spaces) -> bool:
    element = spaces.trial.ufl_element()
    cell = spaces.mesh.topology.cell_name()
    quadratic = quadratic_element(cell, tuple(element.reference_value_shape))
    return spaces.test is spaces.trial and element == quadratic


def _scalar(spaces: Spaces) -> Spaces:
    """The spaces of a component; nodes are numbered alike."""
    if not spaces.trial.num_sub_spaces:
        return spaces
    trial = scalar_space(spaces.trial)
    return Spaces(trial, trial if spaces.test is spaces.trial else scalar_space(spaces.test))


def _at(vector: PETSc.Vec, node: npt.NDArray[np.int64], block: int) -> Array:
    """Entries (m, block) of nodes (m,) by global numbers, on every process."""
    first, last = (end // block for end in vector.getOwnershipRange())
    own = (first <= node) & (node < last)
    values = np.zeros((len(node), block))
    values[own] = vector.array_r.reshape(-1, block)[node[own] - first]
    vector.comm.tompi4py().Allreduce(MPI.IN_PLACE, values)
    return values
