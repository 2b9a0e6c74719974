"""The identity K_PW = T K_Galerkin: where it holds, where it fails, and by how much.

The composite triangle completes it, K_composite = T K_Galerkin T^T: the weights of the new
element for the displacements, too.
"""

from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx.mesh import CellType, Mesh, create_box, create_mesh

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
from pw_elements._compat import cell_nodes
from pw_elements.contact import ContactPair, Motion, Sphere, solve_contact
from pw_elements.elasticity import StressState, nodal_load
from pw_elements.meshes import curved_mesh, move_nodes, triangles
from study.model.discretisation import spaces
from study.model.elements import composite
from study.model.units import dimensionless
from study.run.cases import Case
from study.run.store import Result

SECTION = "T"
TITLE = "What the element is: the identity K_PW = T K_Galerkin"

Array = npt.NDArray[np.float64]

YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
DIVISIONS = (6, 6)
ORDERS = 2
CONSTANT_STRESS = ((-1.0, 0.4), (0.4, -0.3))


@dataclass(frozen=True)
class Quantity:
    """A matrix or vector made from a body, and the setting in which T is tried on it."""

    make: Callable[[Body], PETSc.Mat | PETSc.Vec]
    state: StressState = StressState.PLANE_STRESS
    varying_modulus: bool = False
    curved_sides: bool = False


def _stiffness(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.stiffness())


def _mass(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.mass())


def _initial_stress_G(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.initial_stress(ufl.as_tensor(CONSTANT_STRESS), "G"))


def _initial_stress_J(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.initial_stress(ufl.as_tensor(CONSTANT_STRESS), "J"))


def _initial_stress_linear(body: Body) -> PETSc.Mat:
    return assemble_matrix(body.initial_stress(_linear(body) * ufl.as_tensor(CONSTANT_STRESS)))


def _surface_load(body: Body) -> PETSc.Vec:
    side = boundary_measure(body.spaces.mesh, _fixed_side)
    return assemble_vector(body.surface_load((0.3, -1.0), side))


def _body_load(body: Body) -> PETSc.Vec:
    return assemble_vector(body.body_load((0.3, -1.0)))


def _body_load_linear(body: Body) -> PETSc.Vec:
    return assemble_vector(body.body_load(_linear(body) * ufl.as_vector((0.3, -1.0))))


def _point_load(body: Body) -> PETSc.Vec:
    """On a mid-side node; at a vertex T changes nothing, nor do the weight functions."""
    U = body.spaces.trial
    node = U.tabulate_dof_coordinates()[U.dofmap.list[0, 3]]
    return nodal_load(U, lambda x: np.asarray(np.isclose(x.T, node).all(axis=1)), (0.3, -1.0))


HOLDS = {
    "stiffness-plane-stress": Quantity(_stiffness),
    "stiffness-plane-strain": Quantity(_stiffness, StressState.PLANE_STRAIN),
    "initial-stress-G": Quantity(_initial_stress_G),
    "initial-stress-J": Quantity(_initial_stress_J),
    "surface-load": Quantity(_surface_load),
    "body-load": Quantity(_body_load),
}
FAILS = {
    "mass": Quantity(_mass),
    "stiffness-axisymmetric": Quantity(_stiffness, StressState.AXISYMMETRIC),
    "stiffness-varying-modulus": Quantity(_stiffness, varying_modulus=True),
    "stiffness-curved-sides": Quantity(_stiffness, curved_sides=True),
    "initial-stress-linear": Quantity(_initial_stress_linear),
    "body-load-linear": Quantity(_body_load_linear),
    "point-load": Quantity(_point_load),
}
# Only gradients are projected; displacements as such enter the hoop strain and the mass
COMPOSITE_HOLDS = {
    name: (HOLDS | FAILS)[name]
    for name in (
        "stiffness-plane-stress",
        "stiffness-plane-strain",
        "initial-stress-G",
        "initial-stress-J",
        "initial-stress-linear",
        "stiffness-varying-modulus",
    )
}
COMPOSITE_FAILS = {name: FAILS[name] for name in ("mass", "stiffness-axisymmetric")}


def difference(quantity: str) -> Result:
    """|A_PW - T A_Galerkin| / |A_PW| of a matrix or vector on a distorted mesh."""
    trial = (HOLDS | FAILS)[quantity]
    galerkin, pw = _bodies(trial, Spaces.galerkin, Spaces.petrov_galerkin)
    transferred = _transfer(galerkin.spaces, trial.make(galerkin))
    scalars = {"difference": _relative(trial.make(pw), transferred)}
    return Result(scalars, dimensionless(scalars), dofs=_dofs(galerkin))


def composite_difference(quantity: str) -> Result:
    """|A_composite - T A_Galerkin T^T| / |A_composite| of a matrix on a distorted mesh."""
    trial = (COMPOSITE_HOLDS | COMPOSITE_FAILS)[quantity]
    galerkin, assumed = _bodies(trial, Spaces.galerkin, composite)
    T = force_transfer(galerkin.spaces.trial)
    transferred = T.matMult(trial.make(galerkin)).matMult(T.transpose(PETSc.Mat()))
    scalars = {"difference": _relative(trial.make(assumed), transferred)}
    return Result(scalars, dimensionless(scalars), dofs=_dofs(galerkin))


def statics_2d() -> Result:
    """Displacements and reactions of the elements on a distorted, clamped square."""
    mesh = move_nodes(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), DIVISIONS), distorted)
    galerkin, pw = Spaces.galerkin(mesh), Spaces.petrov_galerkin(mesh)
    a, r = _clamped(galerkin, StressState.PLANE_STRAIN)
    a_pw, r_pw = _clamped(pw, StressState.PLANE_STRAIN)
    a_composite, r_composite = _clamped(composite(mesh), StressState.PLANE_STRAIN)
    transposed = a.duplicate()
    force_transfer(galerkin.trial).multTranspose(a_composite, transposed)
    scalars = {
        "displacement_difference": _relative(a_pw, a),
        "reaction_difference": _relative(r_pw, _transfer(galerkin, r)),
        "reaction_difference_without_T": _relative(r_pw, r),
        "composite_displacement_difference": _relative(a, transposed),
        "composite_displacement_difference_without_T": _relative(a, a_composite),
        "composite_reaction_difference": _relative(r_pw, r_composite),
    }
    return Result(scalars, dimensionless(scalars), dofs=a.getSize())


def statics_3d() -> Result:
    """Displacements of both elements on a clamped cube of tetrahedra."""
    mesh = _tetrahedra((3, 3, 3))
    a, _ = _clamped(Spaces.galerkin(mesh), StressState.SOLID)
    a_pw, _ = _clamped(Spaces.petrov_galerkin(mesh), StressState.SOLID)
    scalars = {"displacement_difference": _relative(a_pw, a)}
    return Result(scalars, dimensionless(scalars), dofs=a.getSize())


def vertex_order(element: str) -> Result:
    """How far nodal values move with the order of the vertices within tetrahedra.

    Over `ORDERS` random orders: the largest change of a displacement and a reaction of the clamped
    cube, and of a nodal force below a rough sphere, each over the largest one of its kind; of the
    latter also the median over the nodes that carry one.
    """
    changes: dict[str, list[Array]] = {}
    sizes: dict[str, float] = {}
    for order in range(ORDERS + 1):
        cube = spaces(element, _tetrahedra((3, 3, 3), order))
        a, r = (_by_place(cube, values) for values in _clamped(cube, StressState.SOLID))
        force = _below_sphere(spaces(element, _tetrahedra((4, 4, 2), order)))
        values = {"displacement": a, "reaction": r, "contact": force}
        if order == 0:
            first, sizes = values, {name: np.abs(v).max() for name, v in values.items()}
            continue
        for name, value in values.items():
            changes.setdefault(name, []).append(np.abs(value - first[name]) / sizes[name])
    scalars = {f"{name}_difference": float(np.max(moved)) for name, moved in changes.items()}
    loaded = np.abs(first["contact"]).max(axis=1) > 1e-9 * sizes["contact"]
    by_node = np.max(changes["contact"], axis=2)
    scalars["contact_difference_median"] = float(np.median(by_node[:, loaded]))
    return Result(scalars, dimensionless(scalars), dofs=a.size)


def _tetrahedra(divisions: tuple[int, int, int], order: int = 0) -> Mesh:
    """A unit cube; vertices in the order of their places within cells, or in a random one."""
    box = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], divisions, CellType.tetrahedron)
    x = box.geometry.x.round(12)
    by_place = np.lexsort(x.T)
    number = np.empty_like(by_place)
    number[by_place] = np.arange(len(x))
    cells = np.sort(number[cell_nodes(box)], axis=1)
    cells = cells[np.lexsort(cells.T)]  # versions of DOLFINx number them differently
    if order > 0:
        cells = np.random.default_rng(order).permuted(cells, axis=1)
    geometry = basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,))
    return create_mesh(MPI.COMM_SELF, cells=cells.astype(np.int64), x=x[by_place], e=geometry)


def _by_place(cube: Spaces, values: PETSc.Vec) -> Array:
    """Nodal values (n, 3), nodes sorted by their coordinates."""
    places = cube.trial.tabulate_dof_coordinates().round(9)
    return np.asarray(values.array_r.reshape(-1, 3)[np.lexsort(places.T)])


def _below_sphere(block: Spaces) -> Array:
    """Nodal forces (m, 3) between a block and a rough rigid sphere that is pressed and dragged."""
    U = block.trial
    body = Body(block, Material(YOUNGS_MODULUS, POISSONS_RATIO), StressState.SOLID)
    K = assemble_matrix(body.stiffness())
    foot = [prescribe(U, i, lambda x: np.isclose(x[2], 0.0)) for i in range(3)]
    motions = [Motion((0.01, 0.005, -0.05))]
    top = ContactPair(lambda x: np.isclose(x[2], 1.0), Sphere((0.5, 0.5, 2.0), 1.0), 0.3, motions)
    held = Reduction.dirichlet(U, foot)
    (state,) = solve_contact(K, K.createVecLeft(), held, [top], U)
    (contact,) = state.pairs
    return np.column_stack([contact.force_normal, contact.force_tangential])


def distorted(x: Array) -> Array:
    """Smooth map (n, 3) to (n, 3) that keeps x = 0 and leaves no two triangles alike."""
    moved = x.copy()
    moved[:, 0] *= 1 + 0.1 * np.cos(3.3 * x[:, 1]) + 0.05 * np.sin(2.1 * x[:, 0])
    moved[:, 1] += 0.07 * np.cos(2.7 * x[:, 0]) * np.sin(1.9 * x[:, 1] + 0.4)
    return moved


def _bodies(quantity: Quantity, *methods: Callable[[Mesh], Spaces]) -> list[Body]:
    """The same body on several elements."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), DIVISIONS)
    mesh = (curved_mesh if quantity.curved_sides else move_nodes)(mesh, distorted)
    modulus = YOUNGS_MODULUS
    if quantity.varying_modulus:
        modulus *= 1 + ufl.SpatialCoordinate(mesh)[0]
    material = Material(modulus, POISSONS_RATIO)
    return [Body(method(mesh), material, quantity.state) for method in methods]


def _dofs(body: Body) -> int:
    return int(body.spaces.trial.dofmap.index_map.size_global * 2)


def _clamped(spaces: Spaces, state: StressState) -> tuple[PETSc.Vec, PETSc.Vec]:
    """Displacements and reactions under a body force, the side x = 0 held."""
    dimension = spaces.mesh.geometry.dim
    body = Body(spaces, Material(YOUNGS_MODULUS, POISSONS_RATIO), state)
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.body_load(np.eye(dimension)[1]))
    held = [prescribe(spaces.trial, i, _fixed_side) for i in range(dimension)]
    a = solve(K, f, Reduction.dirichlet(spaces.trial, held))
    return a, reactions(K, a, f)


def _transfer(spaces: Spaces, A: PETSc.Mat | PETSc.Vec) -> PETSc.Mat | PETSc.Vec:
    T = force_transfer(spaces.trial)
    return T * A if isinstance(A, PETSc.Vec) else T.matMult(A)


def _relative(a: PETSc.Mat | PETSc.Vec, b: PETSc.Mat | PETSc.Vec) -> float:
    return float((a - b).norm() / a.norm())


def _linear(body: Body) -> ufl.core.expr.Expr:
    x = ufl.SpatialCoordinate(body.spaces.mesh)
    return 1 + x[0] - 2 * x[1]


def _fixed_side(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


def _stated(quantity: Quantity, element: str) -> dict[str, object]:
    """What a quantity's name implies of the body; the element that the standard one becomes."""
    return {
        "element": element,
        "state": quantity.state.value,
        "varying_modulus": quantity.varying_modulus,
        "curved_sides": quantity.curved_sides,
        "divisions": DIVISIONS,
    }


CASES = [
    Case("T", name, difference, {"quantity": name}, _stated(quantity, "pw-T6"))
    for name, quantity in (HOLDS | FAILS).items()
]
CASES += [
    Case(
        "T",
        f"composite-{name}",
        composite_difference,
        {"quantity": name},
        _stated(quantity, "composite-T6"),
    )
    for name, quantity in (COMPOSITE_HOLDS | COMPOSITE_FAILS).items()
]
_PLANE = {"compared": ["galerkin-T6", "pw-T6", "composite-T6"], "state": "plane strain"}
_SOLID = {"compared": ["galerkin-T10", "pw-T10"], "state": "solid"}
CASES += [
    Case("T", "statics-2d", statics_2d, implied=_PLANE),
    Case("T", "statics-3d", statics_3d, implied=_SOLID),
]
CASES += [
    Case("T", f"order-{element}", vertex_order, {"element": element}, {"state": "solid"})
    for element in ("galerkin-T10", "pw-T10", "onecut-T10")
]
