"""A tube that is shrunk onto another one, in space."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from dolfinx import fem
from dolfinx.mesh import Mesh, locate_entities_boundary

from pw_elements import Body, Material, Reduction, Spaces, SurfaceNodes, assemble_matrix, prescribe
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact import ContactPair, DeformableSurface, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh
from study.benchmarks.v17_bodies.problems import make_dimensionless_result
from study.meshes.solid_meshes import mesh_box_along_lines
from study.meshes.two_body_meshes import join_lower_and_upper_mesh
from study.model.discretisation import make_element_spaces
from study.run.store import Result
from study.solutions.calculix.calculix import load_recorded_result_if_unchanged
from study.solutions.calculix.shrink_fit import (
    INTERFERENCE,
    LENGTH,
    RADII,
    SHRUNK_TUBES,
    YOUNGS_MODULUS,
    compute_lame_pressure,
    divide_tubes,
)
from study.solutions.rubber import (
    POISSONS_RATIO,
    compare_force_over_weight,
    drop_small_weights,
)

TubeLines = tuple[Array, Array, Array]
"""Mesh lines of a tube: radii, angles, and coordinates along the axis."""


def mesh_tubes(inner: TubeLines, outer: TubeLines) -> tuple[Mesh, tuple[Indices, Indices]]:
    """Mesh sectors of two tubes about the z axis by quadratic tetrahedra with curved sides.

    Args:
        inner: Mesh lines of the inner tube.
        outer: Mesh lines of the outer tube.

    Returns:
        Mesh, and the facets of the bore of the outer tube and of the outside of the inner tube.
    """

    def bend_to_tube(x: Array) -> Array:
        return np.column_stack([x[:, 0] * np.cos(x[:, 1]), x[:, 0] * np.sin(x[:, 1]), x[:, 2]])

    tubes = [
        curved_mesh(mesh_box_along_lines("tetrahedron", *lines), bend_to_tube)
        for lines in (inner, outer)
    ]
    mesh, is_inner_cell = join_lower_and_upper_mesh(*tubes)
    mesh.topology.create_connectivity(2, 3)
    cells_of_facets = mesh.topology.connectivity(2, 3)
    facets = locate_entities_boundary(
        mesh, 2, lambda x: np.isclose(np.hypot(x[0], x[1]), outer[0][0])
    ).astype(np.int64)
    is_inner = is_inner_cell[[cells_of_facets.links(facet)[0] for facet in facets]]
    return mesh, (facets[~is_inner], facets[is_inner])


def _divide(start: float, end: float, cells: int) -> Array:
    return np.linspace(start, end, cells + 1, dtype=np.float64)


def _tube(
    radii: Sequence[float], length: Sequence[float], cells: Sequence[int], angle: float
) -> TubeLines:
    return (
        _divide(radii[0], radii[1], cells[0]),
        _divide(0.0, angle, cells[1]),
        _divide(length[0], length[1], cells[2]),
    )


def _is_on_plane_of_symmetry(axis: int, x: Array) -> Mask:
    return np.asarray(np.isclose(x[axis], 0.0))


def shrink(element: str, around: int) -> Result:
    """Shrink a tube onto another without friction; compare pressures on both sides with Lamé's.

    Args:
        element: Name of the element.
        around: Number of elements of the outer tube around a quarter; the inner one has fewer.
    """
    inner, outer = divide_tubes(around)
    mesh, (bore, shaft) = mesh_tubes(
        _tube(RADII[:2], (0.0, LENGTH), inner, np.pi / 2),
        _tube(RADII[1:], (0.0, LENGTH), outer, np.pi / 2),
    )
    steel = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = Body(make_element_spaces(element, mesh), steel, StressState.SOLID)
    space = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    supports = [prescribe(space, k, partial(_is_on_plane_of_symmetry, k)) for k in range(3)]
    pair = ContactPair(
        fem.locate_dofs_topological(space, 2, bore.astype(np.int32)),
        DeformableSurface(shaft.astype(np.int32), coincident=True),
        interference=INTERFERENCE,
    )
    reduction = Reduction.dirichlet(space, supports)
    (state,) = solve_contact(K, K.createVecRight(), reduction, pair, space)
    (on_bore,) = state.pairs
    exact = compute_lame_pressure(RADII, INTERFERENCE)
    scalar_spaces = make_scalar_spaces(element, mesh)
    x = space.tabulate_dof_coordinates()
    scalars: dict[str, float] = {}
    curves: dict[str, Array] = {}
    for suffix, facets, nodes, force in (
        ("", bore, on_bore.node, on_bore.force_vector),
        ("_master", shaft, on_bore.opposite_node, -on_bore.opposite_force),
    ):
        surface = SurfaceNodes.from_scalar_spaces(scalar_spaces, facets.astype(np.int32))
        weight = np.zeros(len(x))
        weight[surface.node] = surface.weight_area
        radial_direction = x[nodes, :2] / np.linalg.norm(x[nodes, :2], axis=1)[:, None]
        radial_force = np.sum(force[:, :2] * radial_direction, axis=1)
        area = drop_small_weights(weight[nodes])
        errors = compare_force_over_weight(radial_force, area, np.full(len(nodes), exact))
        scalars |= {name + suffix: value for name, value in errors.items()}
        has_weight = area > 0
        curves[f"pressure{suffix}"] = radial_force[has_weight] / area[has_weight] / exact
        curves[f"z{suffix}"] = x[nodes[has_weight], 2]
    total = float(np.sum(on_bore.force_normal))
    scalars["mean_error"] = abs(total / (np.pi / 2 * RADII[1] * LENGTH) / exact - 1)
    return make_dimensionless_result(scalars, curves, 3 * len(x))


def shrink_by_calculix(element: str, case: str, tracked: str) -> Result:
    """Compare pressures that CalculiX prints for nodes of the bore with Lamé's.

    Args:
        element: Name of the element that CalculiX' C3D10 is.
        case: Name of the CalculiX input deck.
        tracked: Digest that the stored solution must have.
    """
    problem = SHRUNK_TUBES[case]
    pressure = load_recorded_result_if_unchanged(case, tracked).numbers["pressure"]
    error = pressure / compute_lame_pressure(RADII, INTERFERENCE) - 1
    scalars = {
        "largest_error": np.abs(error).max(),
        "median_error": np.median(np.abs(error)),
        "mean_error": abs(error.mean()),
    }
    curves = {"pressure": 1 + error, "z": problem.nodes[problem.slave_nodes - 1, 2]}
    return make_dimensionless_result(scalars, curves, problem.nodes.size)


def make_scalar_spaces(element: str, mesh: Mesh) -> Spaces:
    """Return scalar spaces with the weight functions of an element."""
    make = Spaces.petrov_galerkin if element.startswith("pw") else Spaces.galerkin
    return make(mesh, 0)
