"""Known answers for K, M and K_sigma: rods, squares, strips, free bodies, cylinders."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import CellType, Mesh, create_box

from pw_elements import (
    Body,
    Material,
    Reduction,
    assemble_matrix,
    buckling,
    lumped_mass,
    prescribe,
    solve,
    vibration_modes,
)
from pw_elements.algebra import VibrationModes
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from pw_elements.spaces import Marker
from study.model.discretisation import (
    Discretisation,
    discretise,
    is_quadrilateral,
    is_symmetrised,
    mass_left,
    mesh_curves,
    spaces,
)
from study.model.units import dimensionless
from study.paper.s7_6_exact import Strip
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.verification.v8_exact import Rod, rectangle_eigenvalues

SECTION = "V8"
TITLE = "Vibration with known answers"

Array = npt.NDArray[np.float64]
Support = tuple[int, float, int]  # axis and value of a coordinate, displacement component
# Values (n,) on one mesh, numbers that tell of the solver, and the body
Level = tuple[Array, dict[str, float], Discretisation]
Treatment = Literal["transposed", "same", "all nodes", "lumped"]

# E and the density are one, and a length of each body: all numbers are dimensionless
MATERIAL = Material(1.0, 0.3)
MODES = 6
EIGENVALUES = [f"omega2_{n}" for n in range(1, MODES + 1)]
ROD = Rod(MATERIAL, radius=0.5, length=1.0)
ROD_WALLS: list[Support] = [(0, 0.0, 0), (1, 0.0, 1), (1, ROD.length, 1)]
STRIP_LENGTH, STRIP_MODES = 8.0, 3  # over the height; bending modes lie lowest up to the third
RIGID = {StressState.PLANE_STRESS: 3, StressState.AXISYMMETRIC: 1, StressState.SOLID: 6}
TUBE = (1.0, 2.0)  # radii
BENT = 0.05  # largest move of a node within a mesh, over its size
QUADRATURE_DEGREES, QUADRATURE_REFERENCE = (2, 4, 6, 8), 16


def rod(element: str, treatment: Treatment, squares: Sequence[int]) -> Result:
    """Round rod between smooth rigid walls, meshed in axisymmetry."""

    def level(n: int) -> Level:
        sizes, divisions = (ROD.radius, ROD.length), (n, 2 * n)
        body = _rectangle(element, sizes, divisions, StressState.AXISYMMETRIC)
        modes = _modes(body, ROD_WALLS, MODES, treatment)
        return modes.eigenvalues, _quality(modes), body

    return _converging(level, squares, EIGENVALUES, ROD.eigenvalues(MODES))


def square(element: str, treatment: Treatment, squares: Sequence[int]) -> Result:
    """Square in plane stress on rollers all around."""
    rollers: list[Support] = [(i, x, i) for i in (0, 1) for x in (0.0, 1.0)]

    def level(n: int) -> Level:
        body = _rectangle(element, (1.0, 1.0), (n, n), StressState.PLANE_STRESS)
        modes = _modes(body, rollers, MODES, treatment)
        return modes.eigenvalues, _quality(modes), body

    exact = rectangle_eigenvalues(MATERIAL, StressState.PLANE_STRESS, (1.0, 1.0), MODES)
    return _converging(level, squares, EIGENVALUES, exact)


def strip(element: str, treatment: Treatment, squares: Sequence[int]) -> Result:
    """Simply supported strip: rho omega^2 / k^2 in vibration is the critical stress in buckling.

    Values `vibration_n` are the one, `buckling_n` the other. The strip may move along its axis,
    a rigid mode; in buckling a corner is held.
    """
    ends: list[Support] = [(0, 0.0, 1), (0, STRIP_LENGTH, 1)]
    modes = range(1, STRIP_MODES + 1)
    wave_numbers = np.array(modes) * np.pi / STRIP_LENGTH

    def level(n: int) -> Level:
        divisions = (int(STRIP_LENGTH) * n, n)
        body = _rectangle(element, (STRIP_LENGTH, 1.0), divisions, StressState.PLANE_STRESS)
        vibration = _modes(body, ends, STRIP_MODES + 1, treatment)
        stress = MATERIAL.density * vibration.eigenvalues[1:] / wave_numbers**2
        corner = prescribe(body.space, 0, lambda x: np.isclose(x[0], 0.0) & np.isclose(x[1], 0.0))
        prestress = fem.Constant(body.body.spaces.mesh, np.array([[-1.0, 0.0], [0.0, 0.0]]))
        critical = buckling(
            body.K,
            assemble_matrix(body.body.initial_stress(prestress)),
            _reduction(body, [*_conditions(body, ends), corner], treatment),
            STRIP_MODES,
            is_symmetrised(element),
        )
        quality = _quality(vibration)
        quality["residual"] = max(quality["residual"], critical.residuals.max())
        quality["imaginary"] = max(quality["imaginary"], critical.imaginary_ratio)
        return np.concatenate([stress, critical.factors]), quality, body

    theory = Strip(MATERIAL.youngs_modulus, MATERIAL.poissons_ratio, STRIP_LENGTH)
    exact = [theory.elasticity(n, "G") for n in modes]
    names = [f"{kind}_{n}" for kind in ("vibration", "buckling") for n in modes]
    return _converging(level, squares, names, exact * 2)


def free(element: str, state: str) -> Result:
    """A body that nothing holds; u_r = 0 on the axis of axisymmetry is no support.

    Scalars: `rigid` modes of zero frequency, by `rigid_error` too many; the largest of their
    eigenvalues over the first elastic one, `zero`.
    """
    kind = StressState(state)
    build = partial(_mesh, (1.0, 1.0), (6, 6))
    body = discretise(element, _box if kind is StressState.SOLID else build, MATERIAL, kind)
    axis: list[Support] = [(0, 0.0, 0)] if kind is StressState.AXISYMMETRIC else []
    modes = _modes(body, axis, MODES + 1, "transposed")
    eigenvalues = np.abs(modes.eigenvalues)
    scalars = {
        "zero": eigenvalues[: modes.n_rigid].max() / eigenvalues[modes.n_rigid],
        "rigid_error": float(modes.n_rigid - RIGID[kind]),
    }
    scalars |= _quality(modes)
    return Result(scalars, dimensionless(scalars), dofs=body.K.getSize()[0])


def tube(element: str, squares: Sequence[int]) -> Result:
    """Lame's tube under internal pressure between smooth rigid walls: `displacement` vanishes.

    It is the largest error of a node over the largest displacement.
    """
    inner, outer = TUBE
    E, nu = MATERIAL.youngs_modulus, MATERIAL.poissons_ratio

    def radial(r: Array) -> Array:
        factor = (1 + nu) / E * inner**2 / (outer**2 - inner**2)
        return factor * ((1 - 2 * nu) * r + outer**2 / r)

    def level(n: int) -> Level:
        body = _rectangle(element, (outer - inner, 1.0), (n, n), StressState.AXISYMMETRIC, inner)
        error = _pressed(body, [], lambda x: np.isclose(x[0], inner), (1.0, 0.0), radial)
        return np.array([1 + error]), {}, body

    return _converging(level, squares, ["displacement"], [1.0])


def cylinder(element: str) -> Result:
    """Solid cylinder under external pressure: the exact u_r = c r is a trial function."""
    body = _rectangle(element, (1.0, 1.0), (4, 4), StressState.AXISYMMETRIC)
    E, nu = MATERIAL.youngs_modulus, MATERIAL.poissons_ratio
    factor = -(1 + nu) * (1 - 2 * nu) / E
    axis: list[Support] = [(0, 0.0, 0)]
    error = _pressed(body, axis, lambda x: np.isclose(x[0], 1.0), (-1.0, 0.0), lambda r: factor * r)
    scalars = {"displacement_error": error}
    return Result(scalars, dimensionless(scalars), dofs=body.K.getSize()[0])


def quadrature(element: str, squares: int) -> Result:
    """The rod's eigenvalues by quadratures of several degrees.

    Curves: `degree`, and `change` of the eigenvalues, the largest relative one against the
    degree QUADRATURE_REFERENCE; scalar `error`, the largest relative one of the mesh.
    """
    found = {}
    for degree in (*QUADRATURE_DEGREES, QUADRATURE_REFERENCE):
        sizes, divisions = (ROD.radius, ROD.length), (squares, 2 * squares)
        mesh = _mesh(sizes, divisions, "quadrilateral" if is_quadrilateral(element) else "triangle")
        body = Body(
            spaces(element, mesh), MATERIAL, StressState.AXISYMMETRIC, quadrature_degree=degree
        )
        whole = Discretisation(element, body, assemble_matrix(body.stiffness()))
        found[degree] = _modes(whole, ROD_WALLS, MODES, "all nodes").eigenvalues
    limit = found[QUADRATURE_REFERENCE]
    change = [np.abs(found[degree] / limit - 1).max() for degree in QUADRATURE_DEGREES]
    error = np.abs(limit / ROD.eigenvalues(MODES) - 1).max()
    scalars = {"error": error} | {
        f"change_{degree}": value for degree, value in zip(QUADRATURE_DEGREES, change, strict=True)
    }
    curves = {"degree": np.array(QUADRATURE_DEGREES), "change": np.array(change)}
    return Result(scalars, dimensionless(scalars), curves, dofs=whole.K.getSize()[0])


def _modes(
    body: Discretisation, held: list[Support], count: int, treatment: Treatment
) -> VibrationModes:
    """Natural vibrations; `treatment` says what becomes of inner nodes and of the mass."""
    M = assemble_matrix(body.body.mass())
    if treatment == "lumped":
        M = lumped_mass(M, body.space)
    reduction = _reduction(body, _conditions(body, held), treatment)
    return vibration_modes(body.K, M, reduction, count, is_symmetrised(body.element))


def _reduction(
    body: Discretisation, conditions: list[fem.DirichletBC], treatment: Treatment
) -> Reduction:
    if treatment == "all nodes":
        return Reduction.dirichlet(body.space, conditions)
    return mass_left(body.supports(conditions), "same" if treatment == "same" else "transposed")


def _conditions(body: Discretisation, held: list[Support]) -> list[fem.DirichletBC]:
    return [
        prescribe(body.space, component, partial(_on_line, axis, value))
        for axis, value, component in held
    ]


def _on_line(axis: int, value: float, x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[axis], value)


def _converging(
    level: Callable[[int], Level],
    squares: Sequence[int],
    names: Sequence[str],
    exact: Sequence[float],
) -> Result:
    """Values on meshes with more and more squares, coarse to fine.

    Scalars, of the finest mesh: each value by its name, with the endings `_exact`, `_error`
    (relative) and `_order` (in the element size, of the last refinement); `error` is the largest
    size of the errors, `order` the lowest order, `residual` and `imaginary` the largest of all
    meshes. Curves: `squares` (m,), `errors` (m, n), `imaginaries` (m,); the finest mesh.
    """
    found, qualities = [], []
    for n in squares:
        values, quality, body = level(n)
        found.append(values)
        qualities.append(quality)
    errors = np.array(found) / np.array(exact) - 1
    orders = np.log2(np.abs(errors[-2] / errors[-1])) / np.log2(squares[-1] / squares[-2])
    scalars = {name: max(q[name] for q in qualities) for name in qualities[0]}
    scalars |= {"error": np.abs(errors[-1]).max(), "order": orders.min()}
    for i, name in enumerate(names):
        scalars |= {
            name: found[-1][i],
            f"{name}_exact": exact[i],
            f"{name}_error": errors[-1, i],
            f"{name}_order": orders[i],
        }
    scalars = {name: float(value) for name, value in scalars.items()}
    curves = {"squares": np.array(squares), "errors": errors, **mesh_curves(body.space)}
    if "imaginary" in scalars:
        curves["imaginaries"] = np.array([q["imaginary"] for q in qualities])
    return Result(scalars, dimensionless(scalars), curves, dofs=body.K.getSize()[0])


def _quality(modes: VibrationModes) -> dict[str, float]:
    return {
        "rigid": float(modes.n_rigid),
        "residual": modes.residuals.max(),
        "imaginary": modes.imaginary_ratio,
    }


def _pressed(
    body: Discretisation,
    held: list[Support],
    where: Marker,
    traction: tuple[float, float],
    radial: Callable[[Array], Array],
) -> float:
    """Largest displacement error of a node over the largest displacement, between two walls."""
    walls: list[Support] = [(1, 0.0, 1), (1, 1.0, 1)]
    load = body.surface_load(traction, where)
    a = solve(body.K, load, body.supports(_conditions(body, held + walls)))
    exact = np.zeros((a.getSize() // 2, 2))
    exact[:, 0] = radial(body.space.tabulate_dof_coordinates()[:, 0])
    return float(np.abs(a.array_r.reshape(-1, 2) - exact).max() / np.abs(exact).max())


def _rectangle(
    element: str,
    sizes: tuple[float, float],
    divisions: tuple[int, int],
    state: StressState,
    inner: float = 0.0,
) -> Discretisation:
    return discretise(element, partial(_mesh, sizes, divisions, inner=inner), MATERIAL, state)


def _mesh(
    sizes: tuple[float, float], divisions: tuple[int, int], cell: str, inner: float = 0.0
) -> Mesh:
    """Rectangle inner <= x <= inner + a, 0 <= y <= b, whose inner mesh lines are bent."""

    def bent(x: Array) -> Array:
        s, t = np.pi * (x[:, 0] - inner) / sizes[0], np.pi * x[:, 1] / sizes[1]
        moved = x.copy()
        moved[:, 0] += BENT * sizes[0] * np.sin(s) * np.cos(t)
        moved[:, 1] -= BENT * sizes[1] * np.cos(s) * np.sin(t)
        return moved

    build = triangles if cell == "triangle" else quadrilaterals
    return move_nodes(
        build(MPI.COMM_SELF, (inner, 0.0), (inner + sizes[0], sizes[1]), divisions), bent
    )


def _box(_: str) -> Mesh:
    return create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 2, 1)], (2, 4, 2), CellType.tetrahedron)


ELEMENTS = (
    "galerkin-T6",
    "pw-T6",
    "pwsym-T6",
    "galerkin-Q8",
    "pw-Q8",
    "pw-Q9",
    "composite-T6",
)
VARIANTS: dict[str, tuple[str, Treatment]] = {name: (name, "transposed") for name in ELEMENTS}
VARIANTS |= {
    "pw-Q8-same": ("pw-Q8", "same"),
    "pw-Q9-nine": ("pw-Q9", "all nodes"),
    "pw-T6-lumped": ("pw-T6", "lumped"),
    "pw-Q8-lumped": ("pw-Q8", "lumped"),
}
SQUARES = {rod: (4, 8, 16, 32), square: (4, 8, 16, 32), strip: (1, 2, 4, 8)}
FREE_ELEMENTS = {
    StressState.PLANE_STRESS: ELEMENTS,
    StressState.AXISYMMETRIC: ELEMENTS,
    StressState.SOLID: ("galerkin-T10", "pw-T10"),
}


def _cases() -> list[Case]:
    cases = [
        Case(
            "V8",
            f"{run.__name__}-{name}",
            run,
            {"element": element, "treatment": treatment, "squares": squares},
        )
        for run, squares in SQUARES.items()
        for name, (element, treatment) in VARIANTS.items()
    ]
    cases += [
        Case(
            "V8",
            f"free-{state.value.replace(' ', '-')}-{element}",
            free,
            {"element": element, "state": state.value},
        )
        for state, elements in FREE_ELEMENTS.items()
        for element in elements
    ]
    static = [element for element in ELEMENTS if not is_symmetrised(element)]
    for element in static:
        parameters = {"element": element, "squares": (4, 8, 16, 32)}
        cases.append(Case("V8", f"tube-{element}", tube, parameters))
        cases.append(Case("V8", f"cylinder-{element}", cylinder, {"element": element}))
    cases += [
        Case("V8", f"quadrature-{element}", quadrature, {"element": element, "squares": 16})
        for element in ("galerkin-T6", "pw-T6", "pw-Q9")
    ]
    return cases


CASES = mark_costly(
    _cases(), "quadrature-*", "*-pw-Q8-lumped", "[rst]*-pw-Q9", "[rst]*-composite-T6"
)
