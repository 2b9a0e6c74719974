"""Conduction of heat across contact interfaces, and the heat of friction.

A node of a contact pair exchanges the heat flow

    Q = h A (T - T_o)

with the other side. Here A is the integral of the node's weight function over the interface, T its
temperature, and T_o that of the opposite surface at the node, interpolated by the mortar operator
that also distributes the nodal contact forces. The conductance h may depend on the node's pressure
and gap. Nodal flows thus follow from nodal forces in the same way as on the mechanical side, the
opposite side receives what the pair's own side loses, and uniform flows are uniform at the nodes.

The conditions of the interface are added to the equations of conduction in the bodies, which are
ordinary scalar forms. The coupling is staggered: the temperatures of a contact state are solved
for after this state. Temperatures that change the contact, by thermal strains, need a loop.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.arrays import Array, Indices
from pw_elements.checks import (
    arguments,
    call_user_function,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.contact.model import ContactState
from pw_elements.contact.output import make_own_and_opposite_surface
from pw_elements.elasticity import Body
from pw_elements.spaces import Spaces, gather_nodal_values

# Function that returns conductances (k,) for pressures (k,) and gaps (k,) of nodes
Conductance: TypeAlias = Callable[[Array, Array], Array]


@check_same_arguments_on_all_processes
def interface_conduction(
    state: ContactState,
    body: Body,
    temperatures: Spaces,
    conductance: Conductance,
    pair: int = 0,
    tool_temperature: float | None = None,
) -> tuple[PETSc.Mat, PETSc.Vec]:
    """Return the matrix (n, n) and the load (n,) of heat conduction across a contact pair.

    They are added to the equations of the bodies. Here two bars are in contact:

        T, w = ufl.TrialFunction(heat.trial), ufl.TestFunction(heat.test)
        K = assemble_matrix(ufl.inner(k * ufl.grad(T), ufl.grad(w)) * ufl.dx)
        exchange, _ = interface_conduction(state, bars, heat, lambda pressure, gap: 2.0 * pressure)
        K.axpy(1.0, exchange)

    Args:
        state: contact state, with nodal forces and gaps. It may come from a stiffness or a
            residual.
        body: body of the state, from which the areas follow. They are undeformed areas, and in
            plane states and axisymmetry they include thickness and circumference, which the forms
            of conduction have to include, too.
        temperatures: scalar spaces of the temperature, `Spaces.petrov_galerkin(mesh, 0)`.
        conductance: function that returns the heat flow per area and temperature difference at
            each node, for the pressures (k,) and gaps (k,) of the nodes. It is called with the
            pair's nodes that face the other side. Gaps are zero in contact, and infinite where no
            rigid surface faces a node.
        pair: number of the contact pair.
        tool_temperature: temperature of a rigid surface.

    Raises:
        TypeError, ValueError: for spaces of another mesh, conductances that are negative or not
            finite, a missing temperature of a rigid surface, or a temperature of the surface of a
            deformable body.
    """
    sides = _find_exchanging_sides(state, body, temperatures, pair)
    if sides.is_rigid != (tool_temperature is not None):
        raise ValueError(
            "the surface is rigid: give its tool_temperature"
            if sides.is_rigid
            else "tool_temperature is that of a rigid surface, and the pair faces a body"
        )
    if tool_temperature is not None:
        arguments.check_finite_number("tool_temperature", tool_temperature)
    faces_other_side = sides.area > 0
    area = sides.area[faces_other_side]
    pair_state = state.pairs[pair]
    pressure = np.maximum(0.0, pair_state.force_normal[faces_other_side] / area)
    gap = np.maximum(0.0, pair_state.gap[faces_other_side])
    flow_per_temperature = np.zeros_like(sides.area)
    name, comm = "the conductance", temperatures.mesh.comm
    with raise_errors_on_all_processes(comm):
        values = arguments.check_user_function_values(
            name,
            call_user_function(comm, name, conductance, pressure, gap),
            pressure.shape,
            "it takes pressures (k,) and gaps (k,), and gives (k,)",
        )
        if not (np.isfinite(values) & (values >= 0)).all():
            raise ValueError("the conductance is negative or not finite at a node")
        flow_per_temperature[faces_other_side] = values * area
    difference = sp.hstack([sp.eye_array(len(sides.area)), -sides.force_transfer.T], "csr")
    matrix = (difference.T @ sp.diags_array(flow_per_temperature) @ difference).tocsr()
    load = np.zeros(len(sides.dofs))
    load[: len(sides.area)] = flow_per_temperature * (tool_temperature or 0.0)
    return (
        _distribute_matrix(temperatures.trial, sides.dofs, matrix),
        _distribute_vector(temperatures.trial, sides.dofs, load),
    )


@check_same_arguments_on_all_processes
def friction_heat(
    state: ContactState,
    body: Body,
    temperatures: Spaces,
    duration: float,
    pair: int = 0,
    own_share: float = 1.0,
) -> PETSc.Vec:
    """Return the load (n,) of the heat that friction generates in a contact pair.

    At each node it is the work of friction in the last increment, divided by its duration.

    Args:
        state: contact state at the end of the increment.
        body: body of the state.
        temperatures: scalar spaces of the temperature, `Spaces.petrov_galerkin(mesh, 0)`.
        duration: time that the increment takes.
        pair: number of the contact pair.
        own_share: share of the heat that flows into the pair's own side. The rest flows into the
            opposite body, or is lost to a rigid surface.

    Raises:
        TypeError, ValueError: for spaces of another mesh, a duration that is not positive, or a
            share outside of 0 to 1.
    """
    arguments.check_positive("the duration", duration)
    if not 0 <= arguments.check_finite_number("own_share", own_share) <= 1:
        raise ValueError(f"own_share is {own_share}: it is a fraction from 0 to 1")
    sides = _find_exchanging_sides(state, body, temperatures, pair)
    heat = _friction_work_of_increment(state, pair) / duration
    load = np.concatenate([own_share * heat, sides.force_transfer @ ((1 - own_share) * heat)])
    return _distribute_vector(temperatures.trial, sides.dofs, load)


def _friction_work_of_increment(state: ContactState, pair: int) -> Array:
    """Return the work (m,) of friction at the nodes of a pair, summed over substeps.

    The slips of a state that was reached in substeps are sums over all substeps.
    """
    end = state.pairs[pair]
    work, earlier_slip = np.zeros(len(end.gap)), np.zeros_like(end.slip)
    for _, substate in state.substates:
        part = substate.pairs[pair]
        work -= np.sum(part.force_tangential * part.slip, axis=1)
        earlier_slip = earlier_slip + part.slip
    work -= np.sum(end.force_tangential * (end.slip - earlier_slip), axis=1)
    return work


@dataclass(frozen=True)
class _ExchangingSides:
    """The m nodes of a pair and the k nodes that they face, which exchange heat.

    Args:
        area: areas (m,) of the pair's nodes that face the other side.
        force_transfer: matrix (k, m) with the fraction of each nodal force, and of each nodal flow,
            of the pair that each opposite node receives. Its transpose interpolates temperatures.
        dofs: global numbers (m + k,) of the temperatures at the nodes.
        is_rigid: whether the opposite side is a rigid surface.
    """

    area: Array
    force_transfer: sp.csr_array
    dofs: Indices
    is_rigid: bool


def _find_exchanging_sides(
    state: ContactState, body: Body, temperatures: Spaces, pair: int
) -> _ExchangingSides:
    """Check the arguments of a public function, and return the nodes that exchange heat."""
    arguments.check_type("the state", state, ContactState, "ContactProblem.step returns one")
    arguments.check_type("the body", body, Body, "Body(spaces, material, state) makes one")
    arguments.check_type(
        "the spaces", temperatures, Spaces, "Spaces.petrov_galerkin(mesh, 0) makes them"
    )
    if temperatures.trial.value_shape or temperatures.mesh is not body.spaces.mesh:
        raise ValueError(
            "the temperatures need scalar spaces on the mesh of the body: "
            "Spaces.petrov_galerkin(mesh, 0)"
        )
    if arguments.check_integer("pair", pair, 0) >= len(state.pairs):
        raise ValueError(f"there is no contact pair {pair}: the state has {len(state.pairs)}")
    space, pair_state = body.spaces.displacements.trial, state.pairs[pair]
    surface, opposite = make_own_and_opposite_surface(pair, state, body, space)
    assert surface is not None, "a body is given"
    n_nodes, is_rigid = len(pair_state.node), False
    if opposite is not None:
        # the areas in `surface` are NaN where the part that faces the other side is small
        area = opposite.facing_area_of_pair
        opposite_nodes, force_transfer = opposite.node, opposite.force_transfer
    elif (pair_state.faced_node >= 0).all():
        area, opposite_nodes = surface.weight_area, pair_state.faced_node
        force_transfer = sp.eye_array(n_nodes, format="csr")
    else:
        area, opposite_nodes = surface.weight_area, np.empty(0, dtype=np.int64)
        force_transfer, is_rigid = sp.csr_array((0, n_nodes)), True
    nodes = np.concatenate([pair_state.node, opposite_nodes])
    return _ExchangingSides(
        area, force_transfer, _dofs_at_nodes(space, temperatures.trial, nodes), is_rigid
    )


def _dofs_at_nodes(space: fem.FunctionSpace, scalars: fem.FunctionSpace, nodes: Indices) -> Indices:
    """Return the global numbers (k,) of scalar unknowns at nodes, given their global numbers.

    Args:
        space: space of the displacements, in which the nodes are numbered.
        scalars: scalar space with the same nodes.
        nodes: global numbers (k,) of the nodes, the same on all processes.
    """
    index_map = space.dofmap.index_map
    scalar_of_node = np.empty(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    scalar_of_node[space.dofmap.list.ravel()] = scalars.dofmap.list.ravel()
    dof_of_owned_node = scalars.dofmap.index_map.local_to_global(
        scalar_of_node[: index_map.size_local]
    )
    return gather_nodal_values(space, nodes, dof_of_owned_node)


def _distribute_matrix(space: fem.FunctionSpace, dofs: Indices, matrix: sp.csr_array) -> PETSc.Mat:
    """Return the matrix (n, n) of a space with the entries of a matrix (k, k) at dofs (k,)."""
    index_map = space.dofmap.index_map
    (first, end), size = index_map.local_range, index_map.size_global
    entries = matrix.tocoo()
    is_owned = (dofs[entries.row] >= first) & (dofs[entries.row] < end)
    rows, columns = dofs[entries.row[is_owned]] - first, dofs[entries.col[is_owned]]
    local = sp.csr_array((entries.data[is_owned], (rows, columns)), shape=(end - first, size))
    csr = local.indptr.astype(PETSc.IntType), local.indices.astype(PETSc.IntType), local.data
    sizes = (end - first, size)
    return PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=space.mesh.comm)


def _distribute_vector(space: fem.FunctionSpace, dofs: Indices, values: Array) -> PETSc.Vec:
    """Return the vector (n,) of a space with values (k,) at dofs (k,), which may occur twice."""
    index_map = space.dofmap.index_map
    (first, end), size = index_map.local_range, index_map.size_global
    is_owned = (dofs >= first) & (dofs < end)
    vector = PETSc.Vec().createMPI((end - first, size), comm=space.mesh.comm)
    np.add.at(vector.array, dofs[is_owned] - first, values[is_owned])
    return vector
