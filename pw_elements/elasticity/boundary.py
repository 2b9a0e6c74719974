"""Surface measures, prescribed displacements and nodal loads on parts of the boundary."""

from typing import Literal

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh, meshtags

from pw_elements.arrays import RealVector
from pw_elements.checks import arguments, check_same_arguments_on_all_processes
from pw_elements.spaces import (
    EntitySelection,
    Marker,
    SubSpace,
    is_hybrid,
    locate_exterior_facets,
    require_nodes,
)


@check_same_arguments_on_all_processes
def boundary_measure(mesh: Mesh, where: EntitySelection, quadrature_degree: int = 4) -> ufl.Measure:
    """Create a surface measure of a part of the boundary, for `Body.surface_load` and other forms.

    Args:
        mesh: mesh of the body.
        where: part of the boundary, given in one of three ways: a marker, a function of points
            (3, n) that returns a mask (n,) and has to hold at every vertex of a facet; local
            numbers of facets, as returned by `MeshTags.find`; or a mask of all local facets.
        quadrature_degree: degree of quadrature on the facets.

    Raises:
        ValueError: if no exterior facet is selected, the marker raises an error or does not return
            truth values, or a number does not belong to a facet.
    """
    arguments.check_double_precision_mesh(mesh)
    arguments.check_integer("quadrature_degree", quadrature_degree, 0)
    dimension = mesh.topology.dim - 1
    facets = locate_exterior_facets(mesh, where)
    if mesh.comm.allreduce(len(facets), MPI.SUM) == 0:
        raise ValueError("the marker holds on no exterior facet of the mesh: nothing to load")
    tags = meshtags(mesh, dimension, facets, np.ones(len(facets), dtype=np.int32))
    return ufl.Measure(
        "ds",
        domain=mesh,
        subdomain_data=tags,
        subdomain_id=1,
        metadata={"quadrature_degree": quadrature_degree},
    )


@check_same_arguments_on_all_processes
def prescribe(
    space: fem.FunctionSpace,
    component: int | Literal["pressure"],
    where: EntitySelection,
    value: float | fem.Constant = 0.0,
) -> fem.DirichletBC:
    """Prescribe one component of the displacement at all nodes of a part of the body.

    Mid-side nodes are included. A marker may also select interior nodes.

        held = Reduction.dirichlet(U, [prescribe(U, 1, lambda x: np.isclose(x[1], 0))])
        held = Reduction.dirichlet(U, [prescribe(U, k, facet_tags.find(BASE)) for k in (0, 1)])

    Args:
        space: trial space.
        component: number of the component, counted from 0; or "pressure" to prescribe the pressure
            of a hybrid space, which has values at vertices.
        where: marker, a function of points (3, n) that returns a mask (n,); or local numbers of
            facets, as returned by `MeshTags.find`; or a mask of all local facets.
        value: prescribed value. If it is a `fem.Constant`, its value may be changed later.

    Raises:
        ValueError: if no node is selected, the component does not exist, the marker raises an error
            or does not return truth values, or the value is not a finite number.
    """
    arguments.check_function_space(space)
    hybrid = is_hybrid(space)
    is_pressure = hybrid and component == "pressure"
    field = SubSpace.pressure(space) if is_pressure else SubSpace.displacements(space)
    components = field.unknowns.shape[1]
    if not (
        is_pressure or (arguments.is_real_number(component) and component in range(components))
    ):
        raise ValueError(f"component {component}: the space has {components}, counted from 0")
    number = value.value if isinstance(value, fem.Constant) else value
    arguments.check_finite_number("the prescribed value", number)
    axis = 0 if is_pressure else int(component)
    if arguments.is_user_function(where):
        nodes = require_nodes(field.space, "the prescribed nodes", where)
    else:
        # refuse interior facets: if numbers of nodes are passed by mistake, some of them will most
        # likely be numbers of interior facets
        facets = locate_exterior_facets(space.mesh, where, skip_interior=False)
        if space.mesh.comm.allreduce(len(facets), MPI.SUM) == 0:
            raise ValueError("the prescribed part has no facet")
        nodes = fem.locate_dofs_topological(field.space, space.mesh.topology.dim - 1, facets)
    dofs = field.unknowns[nodes, axis]
    part = space.sub(int(is_pressure)) if hybrid else space
    if part.num_sub_spaces:
        part = part.sub(axis)
    prescribed = default_scalar_type(number) if number is value else value
    return fem.dirichletbc(prescribed, np.ascontiguousarray(dofs), part)


@check_same_arguments_on_all_processes
def nodal_load(space: fem.FunctionSpace, where: Marker, force: RealVector) -> PETSc.Vec:
    """Create the load vector (n,) of a concentrated force at each node that a marker selects.

    The vector is valid for any test space whose weight functions are 1 at their nodes.

    Args:
        space: trial space.
        where: marker, a function of points (3, n) that returns a mask (n,).
        force: force (components,) on each selected node.

    Raises:
        ValueError: if no node is selected, the marker raises an error or does not return truth
            values, the force has another number of components than the space, or a component is
            not finite.
    """
    arguments.check_function_space(space)
    comm, field = space.mesh.comm, SubSpace.displacements(space)
    arguments.check_vector("nodal force", force, field.unknowns.shape[1])
    nodes = require_nodes(field.space, "the loaded nodes", where)
    nodes = nodes[nodes < len(field.owned_unknowns)]
    values = np.zeros(field.owned_unknowns.shape)
    values[nodes] = force
    load = PETSc.Vec().createMPI(field.full_sizes, comm=comm)
    load.setArray(field.embed(values.ravel()))
    return load
