"""Tests of the identity K_PW = T K_Galerkin: where it holds, where it fails, and by how much.

For the composite triangle the identity is K_composite = T K_Galerkin T^T. T is the matrix that
transfers the nodal forces of the standard element to those of the new one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx.mesh import CellType, Mesh, create_box, create_mesh
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    force_transfer,
    prescribe,
    reactions,
    solve,
)
from pw_elements._compat import cell_geometry_nodes
from pw_elements.contact import ContactPair, Motion, Sphere, solve_contact
from pw_elements.elasticity import StressState, nodal_load
from pw_elements.meshes import curved_mesh, move_nodes, triangles
from study.judge.checks import check
from study.judge.measures.general import largest, scalar
from study.meshes.distortion import distort_unit_domain_smoothly
from study.model.discretisation import make_element_spaces
from study.model.elements import composite_spaces
from study.model.units import assign_unit_one_to_scalars
from study.publish.plots.style import PAGE_WIDTH
from study.run.cases import Case
from study.run.pages import PageFigure
from study.run.store import Result, Results

Array = npt.NDArray[np.float64]

SECTION = "T"
TITLE = "What the element is: the identity K_PW = T K_Galerkin"
VERIFICATION = ""  # told in the text of the report
FACTS = {
    "geometry": "a unit square; a unit cube",
    "mesh": "6 × 6 squares cut into triangles, distorted, with straight or curved sides; "
    "tetrahedra",
    "material": "linear elastic; E = 1 or 1 + x, ν = 0.3; plane stress, plane strain, "
    "axisymmetric, solid",
    "supports": "none for matrices; the side x = 0 clamped in statics",
    "load": "uniform and linear body and surface loads, a point load, a uniform and a linear "
    "prestress",
    "reference": "T times the standard element's matrices and vectors",
    "uncertainty": "none but round-off where the identity holds",
}

# Problem and proof

PROBLEM = r"""
**The matrix $\boldsymbol{T}$: where the new element is the standard one with its forces redistributed.** Let
$\boldsymbol{T}$ keep three quarters of each mid-side node's equation in its place and add one eighth to the equation at
either end of the side. (A transformation of the same form, with another factor, makes dual multipliers possible for
quadratic mortar methods {{ cite("popp") }}.) On straight-sided triangles with constant data,

$$\boldsymbol{K}_\mathrm{new} = \boldsymbol{T} \boldsymbol{K}_\mathrm{standard}.$$

**Proof.** Let $\varphi$ be a node's weight function minus its row of $\boldsymbol{T} \boldsymbol{N}$, where
$\boldsymbol{N}$ are the shape functions. Along each side $\varphi$ has no mean and no first moment: at a corner both
parts have 1/4 and 1/24, at a mid-side node 1/2 and 1/4, per unit length. Over the triangle $\varphi$ has no mean: both
parts have 1/12 or 1/4. On such a triangle the stress $\sigma$ of a quadratic displacement is linear, so that
$\int \sigma \nabla \varphi\, \mathrm{d}A = \oint \varphi\, \sigma n\, \mathrm{d}s - \mathrm{div}\, \sigma \int \varphi\, \mathrm{d}A = 0$.
The two elements at a side give its nodes the same parts, so that the identity also holds for assembled matrices. ∎

**Conditions.** The proof needs straight sides, and a constant law, thickness and prestress, for the stress to be linear;
and a plane body, or an interval. It covers loads with the same moments: tractions up to linear ones, uniform body loads,
forces at vertices. It fails for linear body loads, forces at mid-side nodes and the mass; in axisymmetry; and for
tetrahedra, where no mid-side node's row is a multiple of the standard one. In contact it needs nodes that all stick, or
slide without friction: $\boldsymbol{T}$ mixes forces of nodes that slip with those of nodes that stick, and gives an open
node beside a closed one a force. A test checks the proof in exact fractions, on a general triangle and with a
counterexample for each condition (`tests/library/test_t_proof.py`).

Displacements then coincide, and the new forces are $\boldsymbol{T}$ times the standard ones. Under these conditions, and
without slip or lift-off, this redistribution is all that the element gains, and it can be applied to the output of
another code. Where the identity fails ({{ ref("identity") }}), the new element is a discretisation in its own right. The
composite triangle of Guo and others {{ cite("guo") }}, which has four linear triangles and one linear strain field, fits
into the same picture. Its stiffness is $\boldsymbol{T} \boldsymbol{K} \boldsymbol{T}^\mathrm{T}$ to within
{{ num(measure("largest", section="T", cases="composite-stiffness-plane-(stress|strain)", name="difference"), 1) }}, so
that on flat surfaces of plane bodies it carries the new element's forces.
"""

# Method

METHOD = r"""
Matrices and load vectors of both elements are assembled on the same distorted mesh, and so are those of the composite
triangle. The defect of an identity is the norm of the difference of its two sides, relative to that of the left side (root
of the sum of squares of all entries). In statics a clamped square and a clamped cube are loaded by a uniform body force, and
their displacements and reactions are compared in the same norm.
"""

YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
SQUARE_DIVISIONS = (6, 6)
CONSTANT_PRESTRESS = ((-1.0, 0.4), (0.4, -0.3))
N_RANDOM_VERTEX_ORDERS = 2
"""Number of random orders of the vertices of tetrahedra that are compared with the sorted order."""


@dataclass(frozen=True)
class TestedMatrixOrVector:
    """A matrix or vector for which an identity is tested, and the properties of its body.

    Args:
        assemble: Function that assembles the matrix or vector for a body.
        state: Stress state of the body.
        varying_modulus: Whether Young's modulus is 1 + x instead of 1.
        curved_sides: Whether the sides of the triangles are curved.
    """

    assemble: Callable[[Body], PETSc.Mat | PETSc.Vec]
    state: StressState = StressState.PLANE_STRESS
    varying_modulus: bool = False
    curved_sides: bool = False


def _assemble_stiffness(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.stiffness())


def _assemble_mass(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.mass())


def _assemble_geometric_stiffness_G(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.geometric_stiffness(ufl.as_tensor(CONSTANT_PRESTRESS), "G"))


def _assemble_geometric_stiffness_J(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.geometric_stiffness(ufl.as_tensor(CONSTANT_PRESTRESS), "J"))


def _assemble_geometric_stiffness_linear_stress(body: Body) -> PETSc.Mat:
    prestress = _linear_function_of_position(body) * ufl.as_tensor(CONSTANT_PRESTRESS)
    return assemble_matrix(body.geometric_stiffness(prestress))


def _assemble_uniform_surface_load(body: Body) -> PETSc.Vec:
    side = boundary_measure(body.spaces.mesh, _is_on_clamped_side)
    return assemble_vector(body.surface_load((0.3, -1.0), side))


def _assemble_uniform_body_load(body: Body) -> PETSc.Vec:
    return assemble_vector(body.body_load((0.3, -1.0)))


def _assemble_linear_body_load(body: Body) -> PETSc.Vec:
    return assemble_vector(
        body.body_load(_linear_function_of_position(body) * ufl.as_vector((0.3, -1.0)))
    )


def _assemble_point_load_at_midside_node(body: Body) -> PETSc.Vec:
    """Assemble a point load at a mid-side node; at a vertex T would not change it."""
    U = body.spaces.trial
    node = U.tabulate_dof_coordinates()[U.dofmap.list[0, 3]]
    return nodal_load(U, lambda x: np.asarray(np.isclose(x.T, node).all(axis=1)), (0.3, -1.0))


IDENTITIES = {
    "stiffness-plane-stress": TestedMatrixOrVector(_assemble_stiffness),
    "stiffness-plane-strain": TestedMatrixOrVector(_assemble_stiffness, StressState.PLANE_STRAIN),
    "initial-stress-G": TestedMatrixOrVector(_assemble_geometric_stiffness_G),
    "initial-stress-J": TestedMatrixOrVector(_assemble_geometric_stiffness_J),
    "surface-load": TestedMatrixOrVector(_assemble_uniform_surface_load),
    "body-load": TestedMatrixOrVector(_assemble_uniform_body_load),
}
"""Matrices and vectors A for which A_PW = T A_Galerkin holds."""
COUNTEREXAMPLES = {
    "mass": TestedMatrixOrVector(_assemble_mass),
    "stiffness-axisymmetric": TestedMatrixOrVector(_assemble_stiffness, StressState.AXISYMMETRIC),
    "stiffness-varying-modulus": TestedMatrixOrVector(_assemble_stiffness, varying_modulus=True),
    "stiffness-curved-sides": TestedMatrixOrVector(_assemble_stiffness, curved_sides=True),
    "initial-stress-linear": TestedMatrixOrVector(_assemble_geometric_stiffness_linear_stress),
    "body-load-linear": TestedMatrixOrVector(_assemble_linear_body_load),
    "point-load": TestedMatrixOrVector(_assemble_point_load_at_midside_node),
}
"""Matrices and vectors A for which A_PW = T A_Galerkin fails."""
COMPOSITE_IDENTITIES = {
    name: (IDENTITIES | COUNTEREXAMPLES)[name]
    for name in (
        "stiffness-plane-stress",
        "stiffness-plane-strain",
        "initial-stress-G",
        "initial-stress-J",
        "initial-stress-linear",
        "stiffness-varying-modulus",
    )
}
"""Matrices for which A_composite = T A_Galerkin T^T holds: they depend on gradients only."""
COMPOSITE_COUNTEREXAMPLES = {
    name: COUNTEREXAMPLES[name] for name in ("mass", "stiffness-axisymmetric")
}
"""Matrices for which this identity fails, because they depend on displacements themselves."""


def difference(quantity: str) -> Result:
    """Compute |A_PW - T A_Galerkin| / |A_PW| for a matrix or vector A on a distorted mesh."""
    tested_quantity = (IDENTITIES | COUNTEREXAMPLES)[quantity]
    galerkin, pw = _make_bodies_on_distorted_mesh(
        tested_quantity, Spaces.galerkin, Spaces.petrov_galerkin
    )
    A_galerkin, A_pw = (tested_quantity.assemble(body) for body in (galerkin, pw))
    scalars = {
        "difference": _relative_difference(
            A_pw, _multiply_by_force_transfer(galerkin.spaces, A_galerkin)
        )
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=_count_dofs(galerkin))


def composite_difference(quantity: str) -> Result:
    """Compute |A_composite - T A_Galerkin T^T| / |A_composite| for a matrix on a distorted mesh."""
    tested_quantity = (COMPOSITE_IDENTITIES | COMPOSITE_COUNTEREXAMPLES)[quantity]
    galerkin, assumed_strain = _make_bodies_on_distorted_mesh(
        tested_quantity, Spaces.galerkin, composite_spaces
    )
    T = force_transfer(galerkin.spaces.trial)
    A_galerkin = tested_quantity.assemble(galerkin)
    A_composite = tested_quantity.assemble(assumed_strain)
    transferred = T.matMult(A_galerkin).matMult(T.transpose(PETSc.Mat()))
    scalars = {"difference": _relative_difference(A_composite, transferred)}
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=_count_dofs(galerkin))


def statics_2d() -> Result:
    """Compare displacements and reactions of three elements on a distorted, clamped square."""
    square = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), SQUARE_DIVISIONS)
    mesh = move_nodes(square, distort_unit_domain_smoothly)
    galerkin, pw = Spaces.galerkin(mesh), Spaces.petrov_galerkin(mesh)
    a, r = _solve_clamped_body_under_body_force(galerkin, StressState.PLANE_STRAIN)
    a_pw, r_pw = _solve_clamped_body_under_body_force(pw, StressState.PLANE_STRAIN)
    a_composite, r_composite = _solve_clamped_body_under_body_force(
        composite_spaces(mesh), StressState.PLANE_STRAIN
    )
    transposed = a.duplicate()
    force_transfer(galerkin.trial).multTranspose(a_composite, transposed)
    scalars = {
        "displacement_difference": _relative_difference(a_pw, a),
        "reaction_difference": _relative_difference(r_pw, _multiply_by_force_transfer(galerkin, r)),
        "reaction_difference_without_T": _relative_difference(r_pw, r),
        "composite_displacement_difference": _relative_difference(a, transposed),
        "composite_displacement_difference_without_T": _relative_difference(a, a_composite),
        "composite_reaction_difference": _relative_difference(r_pw, r_composite),
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=a.getSize())


def statics_3d() -> Result:
    """Compare displacements of the standard and the new element on a clamped cube of tetrahedra."""
    mesh = _mesh_cube_with_vertex_order((3, 3, 3))
    a, _ = _solve_clamped_body_under_body_force(Spaces.galerkin(mesh), StressState.SOLID)
    a_pw, _ = _solve_clamped_body_under_body_force(Spaces.petrov_galerkin(mesh), StressState.SOLID)
    scalars = {"displacement_difference": _relative_difference(a_pw, a)}
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=a.getSize())


def vertex_order(element: str) -> Result:
    """Compute how much nodal results depend on the order of the vertices within tetrahedra.

    `N_RANDOM_VERTEX_ORDERS` random orders are compared with the order by position. Scalars are the
    largest changes of displacements and reactions of a clamped cube and of nodal contact forces
    below a rough sphere, each relative to the largest value, and the median change of the nonzero
    contact forces.
    """
    sorted_values, *permuted_values = (
        _solve_cubes_with_vertex_order(element, seed) for seed in range(N_RANDOM_VERTEX_ORDERS + 1)
    )
    sizes = {name: np.abs(values).max() for name, values in sorted_values.items()}
    changes = {
        name: [np.abs(permuted[name] - values) / sizes[name] for permuted in permuted_values]
        for name, values in sorted_values.items()
    }
    scalars = {f"{name}_difference": float(np.max(values)) for name, values in changes.items()}
    is_loaded = np.abs(sorted_values["contact"]).max(axis=1) > 1e-9 * sizes["contact"]
    nodal_changes = np.max(changes["contact"], axis=2)
    scalars["contact_difference_median"] = float(np.median(nodal_changes[:, is_loaded]))
    n_dofs = sorted_values["displacement"].size
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=n_dofs)


def _solve_cubes_with_vertex_order(element: str, vertex_order_seed: int) -> dict[str, Array]:
    """Solve a clamped cube and a contact problem with a given order of vertices within the cells.

    Args:
        element: Name of the element.
        vertex_order_seed: Seed of the vertex order, see `_mesh_cube_with_vertex_order`.

    Returns:
        "displacement" and "reaction" (n, 3) of the cube, and "contact" forces (m, 3), all sorted by
        the position of the nodes.
    """
    cube_spaces = make_element_spaces(
        element, _mesh_cube_with_vertex_order((3, 3, 3), vertex_order_seed)
    )
    a, r = _solve_clamped_body_under_body_force(cube_spaces, StressState.SOLID)
    return {
        "displacement": _sort_nodal_values_by_position(cube_spaces, a),
        "reaction": _sort_nodal_values_by_position(cube_spaces, r),
        "contact": _compute_contact_forces_below_sphere(
            make_element_spaces(element, _mesh_cube_with_vertex_order((4, 4, 2), vertex_order_seed))
        ),
    }


def _mesh_cube_with_vertex_order(
    divisions: tuple[int, int, int], vertex_order_seed: int = 0
) -> Mesh:
    """Create the mesh of a unit cube of boxes, each divided into six tetrahedra.

    Args:
        divisions: Number of boxes along each axis.
        vertex_order_seed: Seed of a random order of the vertices within each cell; 0 for vertices
            sorted by position.
    """
    cube = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], divisions, CellType.tetrahedron)
    x = cube.geometry.x.round(12)
    by_position = np.lexsort(x.T)
    number = np.empty_like(by_position)
    number[by_position] = np.arange(len(x))
    cells = np.sort(number[cell_geometry_nodes(cube)], axis=1)
    cells = cells[np.lexsort(cells.T)]  # their numbering depends on the version of DOLFINx
    if vertex_order_seed > 0:
        cells = np.random.default_rng(vertex_order_seed).permuted(cells, axis=1)
    geometry = basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,))
    return create_mesh(MPI.COMM_SELF, cells=cells.astype(np.int64), x=x[by_position], e=geometry)


def _sort_nodal_values_by_position(element_spaces: Spaces, values: PETSc.Vec) -> Array:
    """Return nodal values as an array (n, 3) whose rows are sorted by the nodes' coordinates."""
    x = element_spaces.trial.tabulate_dof_coordinates().round(9)
    return np.asarray(values.array_r.reshape(-1, 3)[np.lexsort(x.T)])


def _compute_contact_forces_below_sphere(element_spaces: Spaces) -> Array:
    """Return nodal contact forces (m, 3) below a rough rigid sphere that is pressed and dragged."""
    U = element_spaces.trial
    body = Body(element_spaces, Material(YOUNGS_MODULUS, POISSONS_RATIO), StressState.SOLID)
    K = assemble_matrix(body.stiffness())
    supports = Reduction.dirichlet(
        U, [prescribe(U, i, lambda x: np.isclose(x[2], 0.0)) for i in range(3)]
    )
    motions = [Motion((0.01, 0.005, -0.05))]
    top = ContactPair(lambda x: np.isclose(x[2], 1.0), Sphere((0.5, 0.5, 2.0), 1.0), 0.3, motions)
    (state,) = solve_contact(K, K.createVecLeft(), supports, [top], U)
    (contact,) = state.pairs
    return np.column_stack([contact.force_normal, contact.force_tangential])


def _make_bodies_on_distorted_mesh(
    quantity: TestedMatrixOrVector, *space_makers: Callable[[Mesh], Spaces]
) -> list[Body]:
    """Create the body of a quantity for each kind of element space on one distorted mesh."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), SQUARE_DIVISIONS)
    mesh = (curved_mesh if quantity.curved_sides else move_nodes)(
        mesh, distort_unit_domain_smoothly
    )
    modulus = YOUNGS_MODULUS
    if quantity.varying_modulus:
        modulus *= 1 + ufl.SpatialCoordinate(mesh)[0]
    material = Material(modulus, POISSONS_RATIO)
    return [Body(make_spaces(mesh), material, quantity.state) for make_spaces in space_makers]


def _count_dofs(body: Body) -> int:
    return int(body.spaces.trial.dofmap.index_map.size_global * 2)


def _solve_clamped_body_under_body_force(
    element_spaces: Spaces, state: StressState
) -> tuple[PETSc.Vec, PETSc.Vec]:
    """Solve for displacements and reactions under a body force, with the side x = 0 clamped."""
    dimension = element_spaces.mesh.geometry.dim
    body = Body(element_spaces, Material(YOUNGS_MODULUS, POISSONS_RATIO), state)
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.body_load(np.eye(dimension)[1]))
    supports = [prescribe(element_spaces.trial, i, _is_on_clamped_side) for i in range(dimension)]
    a = solve(K, f, Reduction.dirichlet(element_spaces.trial, supports))
    return a, reactions(K, a, f)


def _multiply_by_force_transfer(
    element_spaces: Spaces, A: PETSc.Mat | PETSc.Vec
) -> PETSc.Mat | PETSc.Vec:
    T = force_transfer(element_spaces.trial)
    return T * A if isinstance(A, PETSc.Vec) else T.matMult(A)


def _relative_difference(a: PETSc.Mat | PETSc.Vec, b: PETSc.Mat | PETSc.Vec) -> float:
    return float((a - b).norm() / a.norm())


def _linear_function_of_position(body: Body) -> ufl.core.expr.Expr:
    x = ufl.SpatialCoordinate(body.spaces.mesh)
    return 1 + x[0] - 2 * x[1]


def _is_on_clamped_side(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


# Cases


def _parameters_implied_by_quantity(
    quantity: TestedMatrixOrVector, element: str
) -> dict[str, object]:
    """Return the parameters of a quantity (element, stress state, mesh) to store with results."""
    return {
        "element": element,
        "state": quantity.state.value,
        "varying_modulus": quantity.varying_modulus,
        "curved_sides": quantity.curved_sides,
        "divisions": SQUARE_DIVISIONS,
    }


CASES = [
    Case(
        "T",
        name,
        difference,
        {"quantity": name},
        _parameters_implied_by_quantity(quantity, "pw-T6"),
    )
    for name, quantity in (IDENTITIES | COUNTEREXAMPLES).items()
]
CASES += [
    Case(
        "T",
        f"composite-{name}",
        composite_difference,
        {"quantity": name},
        _parameters_implied_by_quantity(quantity, "composite-T6"),
    )
    for name, quantity in (COMPOSITE_IDENTITIES | COMPOSITE_COUNTEREXAMPLES).items()
]
PLANE_STATICS_PARAMETERS = {
    "compared": ["galerkin-T6", "pw-T6", "composite-T6"],
    "state": "plane strain",
}
SOLID_STATICS_PARAMETERS = {"compared": ["galerkin-T10", "pw-T10"], "state": "solid"}
CASES += [
    Case("T", "statics-2d", statics_2d, implied_parameters=PLANE_STATICS_PARAMETERS),
    Case("T", "statics-3d", statics_3d, implied_parameters=SOLID_STATICS_PARAMETERS),
]
CASES += [
    Case("T", f"order-{element}", vertex_order, {"element": element}, {"state": "solid"})
    for element in ("galerkin-T10", "pw-T10", "onecut-T10")
]

# Results

RESULT = r"""
{% call table("identity", "Relative difference between a matrix or vector of the new element and T times that of the standard one, on a distorted mesh of straight-sided triangles unless stated otherwise.") %}
| The identity holds | difference | It fails | difference | It fails | difference |
|---|---:|---|---:|---|---:|
{% for holding, holding_key, failing, failing_key, other, other_key in [
  ("stiffness, plane stress", "stiffness-plane-stress", "stiffness, varying modulus", "stiffness-varying-modulus", "initial stress, linear prestress", "initial-stress-linear"),
  ("stiffness, plane strain", "stiffness-plane-strain", "stiffness, curved sides", "stiffness-curved-sides", "mass", "mass"),
  ("initial stress, uniform prestress", "initial-stress-G", "stiffness, axisymmetry", "stiffness-axisymmetric", "body load, linear", "body-load-linear"),
  ("uniform surface load", "surface-load", "tetrahedra: displacements", none, "point load on a mid-side node", "point-load")] %}
| {{ holding }} | {{ num(s("T/" ~ holding_key, "difference"), 1) }} | {{ failing }} | {{ num(s("T/" ~ failing_key, "difference") if failing_key else s("T/statics-3d", "displacement_difference"), 2) }} | {{ other }} | {{ num(s("T/" ~ other_key, "difference"), 2) }} |
{% endfor %}
{% endcall %}
"""

DETAILS = r"""
{{ figure("t_identity") }}
"""

PLOTTED_QUANTITIES = (
    "stiffness-plane-stress",
    "stiffness-plane-strain",
    "initial-stress-G",
    "initial-stress-J",
    "surface-load",
    "body-load",
    "stiffness-varying-modulus",
    "body-load-linear",
    "stiffness-curved-sides",
    "stiffness-axisymmetric",
    "initial-stress-linear",
    "mass",
    "point-load",
)
PLOTTED_COMPOSITE_QUANTITIES = (
    "stiffness-plane-stress",
    "stiffness-plane-strain",
    "initial-stress-G",
    "initial-stress-J",
    "stiffness-varying-modulus",
    "initial-stress-linear",
    "stiffness-axisymmetric",
    "mass",
)
PLOTTED_CASES = PLOTTED_QUANTITIES + tuple(
    f"composite-{name}" for name in PLOTTED_COMPOSITE_QUANTITIES
)
IDENTITY_COLOUR, COUNTEREXAMPLE_COLOUR = "#333333", "#BBBBBB"  # not used for any element
ROUND_OFF_BOUND = 1e-12
"""Relative difference below which an identity counts as satisfied up to round-off."""
SMALLEST_DRAWN_DIFFERENCE = 1e-17
"""Left end of the logarithmic axis."""


def draw_differences_from_identities(results: Results) -> Figure:
    """Draw the relative differences of both sides of the identities as bars.

    The upper panel tests A_PW = T A_Galerkin and the lower one A_composite = T A_Galerkin Tᵀ, with
    one bar for each matrix or vector.
    """
    heights = (len(PLOTTED_QUANTITIES), len(PLOTTED_COMPOSITE_QUANTITIES))
    fig, axes = plt.subplots(2, 1, figsize=(PAGE_WIDTH, 3.6), sharex=True, height_ratios=heights)
    _draw_difference_bars(axes[0], results, PLOTTED_QUANTITIES, "")
    _draw_difference_bars(axes[1], results, PLOTTED_COMPOSITE_QUANTITIES, "composite-")
    axes[0].set_title(r"(a) new: $\mathbf{A} = \mathbf{T\,A}_\mathrm{standard}$")
    composite_identity = r"$\mathbf{A} = \mathbf{T\,A}_\mathrm{standard}\mathbf{T}^\mathsf{T}$"
    axes[1].set_title(f"(b) composite: {composite_identity}")
    axes[1].set_xlabel("relative difference of both sides")
    return fig


def _draw_difference_bars(ax: Axes, results: Results, names: Sequence[str], prefix: str) -> None:
    differences = [results.scalar(f"T/{prefix}{name}", "difference") for name in names]
    colours = [
        IDENTITY_COLOUR if value < ROUND_OFF_BOUND else COUNTEREXAMPLE_COLOUR
        for value in differences
    ]
    ax.barh(
        range(len(names)), differences, color=colours, left=SMALLEST_DRAWN_DIFFERENCE, height=0.65
    )
    for row, value in enumerate(differences):
        mantissa, _, power = f"{value:.1e}".partition("e")
        number = rf"${mantissa} \times 10^{{{int(power)}}}$"
        ax.annotate(
            number, (max(value, SMALLEST_DRAWN_DIFFERENCE) * 1.4, row), va="center", fontsize=7
        )
    ax.set_yticks(range(len(names)), [_format_quantity_name(name) for name in names])
    ax.set(xscale="log", xlim=(SMALLEST_DRAWN_DIFFERENCE, 10))
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")


def _format_quantity_name(name: str) -> str:
    """Format the name of a case as "quantity, setting", e.g. "stiffness, plane stress"."""
    quantities = ("stiffness", "initial-stress", "body-load")
    quantity = next((q for q in quantities if name.startswith(f"{q}-")), name)
    setting = name.removeprefix(quantity).removeprefix("-").replace("-", " ")
    return ", ".join(filter(None, (quantity.replace("-", " "), setting)))


def describe_differences_from_identities(results: Results) -> str:
    """Return the alternative text of `draw_differences_from_identities`, with all differences."""
    return "Bars on a logarithmic scale: " + "; ".join(
        f"{name.replace('-', ' ')} {results.scalar(f'T/{name}', 'difference'):.1e}"
        for name in PLOTTED_CASES
    )


FIGURES = [
    PageFigure(
        "t_identity",
        draw_differences_from_identities,
        needs=[f"T/{name}" for name in PLOTTED_CASES],
        caption="Relative differences in norm between both sides of the identities, for matrices "
        "and load vectors A on a distorted mesh of straight-sided triangles (curved ones where "
        "named). Dark: an identity up to round-off. Light: no identity.",
        alt=describe_differences_from_identities,
    ),
]

# Findings

CHECKS = [
    check(
        "T-stiffness-plane-stress",
        "PW = T Galerkin for the stiffness in plane stress.",
        lambda results: scalar(results, key="T/stiffness-plane-stress", name="difference"),
        "=",
        0.0,
        tolerance=1e-13,
        tolerance_why="round-off of a small linear system",
        why="On straight triangles with constant data only averages of the test functions' "
        "gradients enter.",
    ),
    check(
        "T-solid",
        "In 3-D the new element is another discretisation: its displacements differ.",
        lambda results: scalar(results, key="T/statics-3d", name="displacement_difference"),
        ">",
        0.0001,
        tolerance_why="far above round-off, far below the measured value",
        why="No T exists there.",
    ),
    check(
        "T-composite-stiffness",
        "The composite triangle's stiffness is T K_Galerkin T^T.",
        lambda results: largest(
            results,
            section="T",
            cases={
                "element": "composite-T6",
                "quantity": ["stiffness-plane-strain", "stiffness-plane-stress"],
            },
            name="difference",
        ),
        "=",
        0.0,
        tolerance=1e-13,
        tolerance_why="round-off of a small linear system",
        why="The projected gradient of a piecewise-linear function is the gradient of the "
        "quadratic one whose mid-side value is 3/4 of its own and 1/8 of either vertex'.",
    ),
]

FINDINGS = r"""
**Three dimensions.** On a face of a standard 10-node tetrahedron the corners' shape functions integrate to zero: under a
uniform pressure the corners carry nothing and each mid-side node a third of the force on the face. The new weights give
every node a share. The octahedron that remains when a tetrahedron's corners are cut off can be divided along any of
three diagonals; the weights used here are the mean over the three divisions. Renumbering the vertices then changes the
reactions of a clamped cube by only {{ num(s("T/order-pw-T10", "reaction_difference"), 1) }} of the largest one; with a
single division it would change them by {{ pct(s("T/order-onecut-T10", "reaction_difference")) }}.
"""

FURTHER_FINDINGS = r"""
1. In plane statics the displacements therefore coincide (relative difference
   {{ num(s("T/statics-2d", "displacement_difference"), 2) }}), and the reactions are $\boldsymbol{T}$ times the standard
   ones (relative difference {{ num(s("T/statics-2d", "reaction_difference"), 2) }}; without $\boldsymbol{T}$
   {{ num(s("T/statics-2d", "reaction_difference_without_T"), 2) }}).
2. **No diagonal.** The midpoints of a tetrahedron's edges leave an octahedron inside, which any one of three diagonals
   divides into four tetrahedra; the choice of diagonal would depend on the order of the vertices. The weights of the new
   element are the mean over the three cuts and are linear on twelve sub-tetrahedra. Changing the order of the vertices
   then changes results only by round-off. If the octahedron is cut along one diagonal instead, the order changes the
   reactions of the clamped cube by {{ pct(s("T/order-onecut-T10", "reaction_difference")) }} of the largest one and the
   forces below a rough sphere by {{ pct(s("T/order-onecut-T10", "contact_difference")) }} (median
   {{ pct(s("T/order-onecut-T10", "contact_difference_median")) }}), on these coarse meshes:

{% call table("t-dependence-on-the-order-of-vertices", "Dependence on the order of vertices.") %}
| Largest change over the largest value | Displacements | Reactions | Contact forces |
|---|---:|---:|---:|
{% for element, name in (("galerkin-T10", "standard T10"), ("pw-T10", "new T10, mean of the three cuts"), ("onecut-T10", "new T10, one cut")) %}
| {{ name }} |{% for value in ("displacement", "reaction", "contact") %} {{ num(s("T/order-" ~ element, value ~ "_difference"), 2) }} |{% endfor %}

{% endfor %}
{% endcall %}

3. **The composite triangle completes the picture:
   $\boldsymbol{K}_\mathrm{composite} = \boldsymbol{T} \boldsymbol{K}_\mathrm{Galerkin} \boldsymbol{T}^\mathrm{T}$.** Four
   linear triangles with a linear assumed strain (Guo, Ortiz, Belytschko and Repetto 2000), a symmetric element with even
   nodal forces, are the standard element after the change of variables
   $a_\mathrm{Galerkin} = \boldsymbol{T}^\mathrm{T} a_\mathrm{composite}$, since a projected gradient is the gradient of a
   quadratic function. The identity holds for the stiffness (relative difference
   {{ num(measure("largest", section="T", cases="composite-stiffness-plane-(stress|strain)", name="difference"), 2) }}; with
   a varying modulus {{ num(s("T/composite-stiffness-varying-modulus", "difference"), 2) }}) and the initial stress matrix
   (with a linear prestress, too:
   {{ num(measure("largest", section="T", cases="composite-initial-stress-(G|J|linear)", name="difference"), 2) }}), and
   fails where displacements enter as such: in axisymmetry
   ({{ num(s("T/composite-stiffness-axisymmetric", "difference"), 2) }}; the hoop strain is not projected here) and for the
   mass ({{ num(s("T/composite-mass", "difference"), 2) }}). In plane statics its nodal forces are the new element's
   (relative difference {{ num(s("T/statics-2d", "composite_reaction_difference"), 2) }}), its stresses and its vertex
   displacements those of the standard element; only the displacements of its mid-side nodes are different (all
   displacements together differ by
   {{ num(s("T/statics-2d", "composite_displacement_difference_without_T"), 2) }} there, and after multiplication by
   $\boldsymbol{T}^\mathrm{T}$ by {{ num(s("T/statics-2d", "composite_displacement_difference"), 2) }}). In contact that
   matters: mid-side nodes are where gaps are measured.
"""

# Limits

LIMITS = r"""
An identity of matrices says nothing about which of the two elements is better where they differ. It does say that
comparing displacements in plane statics cannot tell whether the test space is right.
"""
