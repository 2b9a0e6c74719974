"""Contact problems at large strains with known solutions.

Two problems have a uniform deformation; the third approaches Hertz's line contact as strains become
small.
"""

from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.optimize import brentq

from pw_elements import prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, Motion, Plane, Sphere
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_lines import geometrically_growing_lines
from study.meshes.solid_meshes import mesh_box_along_lines
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.rubber import (
    POISSONS_RATIO,
    Array,
    LoadHistory,
    NeoHookeanBody,
    first_lame_constant_over_shear_modulus,
    solve_increments_of_tool_motion,
)

Mask = npt.NDArray[np.bool_]

DEGREE = {2: 4, 3: 2}
"""Degree of quadrature by dimension, for all problems of the section."""
PLATE_COMPRESSION, PLATE_SHEAR = 0.4, 0.5
"""Downward and sideways displacement of the plate over the height of the cube."""
N_INCREMENTS = 2
STICKING_FRICTION = 2.0
"""Coefficient of friction that is large enough to prevent slip."""

# Hertz's limit: lengths relative to the half width of contact
HERTZ_ELEMENTS = 8
"""Elements over the half width of contact."""
HERTZ_EXTENT, HERTZ_GROWTH = 24.0, 1.35
"""Depth and half width of the block, and size ratio of adjacent elements beside the contact."""
INNER_RADIUS = 0.8
"""Distance from the middle over the contact's half width, within which pressures are compared."""


def compressed(element: str) -> Result:
    """Compress a rubber cube with free sides by a smooth plate; return errors.

    Args:
        element: Element name, "pw-T6" or "pw-T10" for example.
    """
    rubber = _make_rubber_cube(element)
    dim, space, height = rubber.dim, rubber.solution.function_space, 1 - PLATE_COMPRESSION
    supports = [prescribe(space, k, partial(_is_at_coordinate_zero, axis=k)) for k in range(dim)]

    def compression_gradient(lateral_stretch: float) -> Array:
        return np.diag([*[lateral_stretch] * (dim - 1), height])

    lateral_stretch = brentq(
        lambda s: _piola_kirchhoff_stress(compression_gradient(s))[0, 0], 0.8, 2.0, xtol=1e-15
    )
    plate = ContactPair(lambda x: np.isclose(x[dim - 1], 1), _make_rigid_plate(dim))
    motions = [_make_plate_motion(dim, 0.0, k / N_INCREMENTS) for k in range(1, N_INCREMENTS + 1)]
    history = solve_increments_of_tool_motion(
        rubber, plate, supports, motions, np.isclose(rubber.x[:, -1], 0)
    )
    return _compare_with_uniform_deformation(rubber, history, compression_gradient(lateral_stretch))


def sheared(element: str) -> Result:
    """Compress and shear a rubber cube by a sticking plate; return errors.

    The displacements of the uniform deformation are prescribed on the base and on all sides.

    Args:
        element: Element name, "pw-T6" or "pw-T10" for example.
    """
    rubber = _make_rubber_cube(element)
    dim, space = rubber.dim, rubber.solution.function_space
    F = np.eye(dim)
    F[-1, -1], F[0, -1] = 1 - PLATE_COMPRESSION, PLATE_SHEAR
    x = rubber.x
    is_base = np.isclose(x[:, -1], 0)
    is_side = (np.isclose(x, 0) | np.isclose(x, 1))[:, : dim - 1].any(axis=1)
    is_held = is_base | is_side
    prescribed, nodes = fem.Function(space), np.flatnonzero(is_held).astype(np.int32)

    def is_below_plate(x: Array) -> Mask:
        is_inside = ((x[: dim - 1] > 1e-9) & (x[: dim - 1] < 1 - 1e-9)).all(axis=0)
        return np.asarray(np.isclose(x[dim - 1], 1) & is_inside)

    def set_prescribed_displacements(increment: int, load_factor: float) -> None:
        fraction = (increment + load_factor) / N_INCREMENTS
        prescribed.x.array[:] = fraction * (x @ (F - np.eye(dim)).T).ravel()

    plate = ContactPair(is_below_plate, _make_rigid_plate(dim), friction=STICKING_FRICTION)
    motions = [
        _make_plate_motion(dim, PLATE_SHEAR * k / N_INCREMENTS, k / N_INCREMENTS)
        for k in range(1, N_INCREMENTS + 1)
    ]
    supports = [fem.dirichletbc(prescribed, nodes)]
    history = solve_increments_of_tool_motion(
        rubber, plate, supports, motions, is_held, set_prescribed_displacements
    )
    return _compare_with_uniform_deformation(rubber, history, F)


def hertz(element: str, radius: float) -> Result:
    """Press a rigid cylinder on rubber with the force for which Hertz's contact half width is one.

    Strains become small as the radius of the cylinder grows.

    Args:
        element: Element name such as "pw-T6".
        radius: Radius of the cylinder over the contact half width.
    """
    size = 1 / HERTZ_ELEMENTS
    near = np.linspace(-2, 2, 4 * HERTZ_ELEMENTS + 1)
    far = 2 + geometrically_growing_lines(size, HERTZ_EXTENT - 2, HERTZ_GROWTH)[1:]
    lines = np.concatenate([-far[::-1], near, far])
    depths = -geometrically_growing_lines(size, HERTZ_EXTENT, HERTZ_GROWTH)[::-1]
    mesh = mesh_along_lines(MPI.COMM_SELF, lines, depths, "triangle")
    rubber = NeoHookeanBody(element, mesh, DEGREE[2])
    space = rubber.solution.function_space

    def is_base(x: Array) -> Mask:
        return np.asarray(np.isclose(x[1], -HERTZ_EXTENT))

    supports = [prescribe(space, axis, is_base) for axis in (0, 1)]
    modulus = 2 / (1 - POISSONS_RATIO)  # plane-strain modulus over the shear modulus
    force, peak = np.pi * modulus / (4 * radius), modulus / (2 * radius)
    pair = ContactPair(
        lambda x: np.isclose(x[1], 0) & (np.abs(x[0]) < 1.9), Sphere((0.0, radius), radius)
    )
    motions = [Motion((0.0, -0.5 / radius)), Motion((0.0, None), force=(0.0, -force))]
    history = solve_increments_of_tool_motion(rubber, pair, supports, motions, is_base(rubber.x.T))
    last = history.states[-1].pairs[0]
    pressure = last.force_normal / rubber.undeformed_and_deformed_weight_integrals(last.node)[1]
    position = (last.position + last.displacement)[:, 0]
    is_inner = np.abs(last.position[:, 0]) < INNER_RADIUS
    exact = peak * np.sqrt(1 - np.where(is_inner, position, 0.0) ** 2)
    error = (pressure - exact)[is_inner] / peak
    scalars = {
        "pressure_rms": float(np.sqrt(np.mean(error**2))),
        "peak_over_hertz": float(pressure.max() / peak),
        "balance": float(abs(last.force[1] + force) / force),
        "base_defect": history.max_force_imbalance_over_last_tool_force(),
    }
    curves = {"x": position, "pressure": pressure / peak}
    return make_dimensionless_rubber_result(scalars, curves, rubber)


def _is_at_coordinate_zero(x: Array, axis: int) -> Mask:
    return np.asarray(np.isclose(x[axis], 0))


def _make_rubber_cube(element: str) -> NeoHookeanBody:
    is_plane = element.endswith("T6")
    lines: Array = np.linspace(0.0, 1.0, 4 if is_plane else 3, dtype=np.float64)
    if is_plane:
        mesh = mesh_along_lines(MPI.COMM_SELF, lines, lines, "triangle")
        return NeoHookeanBody(element, mesh, DEGREE[2])
    return NeoHookeanBody(
        element, mesh_box_along_lines("tetrahedron", lines, lines, lines), DEGREE[3]
    )


def _make_rigid_plate(dim: int) -> Plane:
    """Make a rigid plate at height one that presses downwards.

    Args:
        dim: Dimension of space.
    """
    up = np.eye(dim)[-1]
    return Plane(tuple(up), tuple(-up))


def _make_plate_motion(dim: int, sideways_motion: float, compression_fraction: float) -> Motion:
    return Motion((sideways_motion, *[0.0] * (dim - 2), -PLATE_COMPRESSION * compression_fraction))


def _piola_kirchhoff_stress(F: Array) -> Array:
    """Return the neo-Hookean first Piola-Kirchhoff stress over the shear modulus.

    Args:
        F: Deformation gradient (dim, dim); in two dimensions, that of plane strain.
    """
    inverse = np.linalg.inv(F).T
    return (
        F
        - inverse
        + first_lame_constant_over_shear_modulus(POISSONS_RATIO)
        * np.log(np.linalg.det(F))
        * inverse
    )


def _compare_with_uniform_deformation(
    rubber: NeoHookeanBody, history: LoadHistory, deformation_gradient: Array
) -> Result:
    """Return errors of contact forces, displacements and areas against a uniform deformation.

    Args:
        rubber: Rubber cube.
        history: Solved load history.
        deformation_gradient: Deformation gradient (dim, dim) of the exact solution.
    """
    pair = history.states[-1].pairs[0]
    traction = _piola_kirchhoff_stress(deformation_gradient)[:, -1]
    undeformed_area, deformed_area = rubber.undeformed_and_deformed_weight_integrals(pair.node)
    expected = undeformed_area[:, None] * traction
    largest_force = np.abs(expected).max()
    exact_displacement = rubber.x @ (deformation_gradient - np.eye(rubber.dim)).T
    area_stretch = np.linalg.det(deformation_gradient) * np.linalg.norm(
        np.linalg.inv(deformation_gradient).T[:, -1]
    )
    scalars = {
        "force_error": np.abs(pair.force_vector - expected).max() / largest_force,
        "displacement_error": np.abs(rubber.displacement - exact_displacement).max(),
        "area_error": np.abs(deformed_area / undeformed_area - area_stretch).max(),
        "base_defect": history.max_force_imbalance_over_last_tool_force([*range(rubber.dim)]),
        "sticking": np.mean(pair.status == STICK),
        "closed": np.mean(pair.status != OPEN),
        "pressure": -traction[-1],
        "shear": traction[0],
    }
    return make_dimensionless_rubber_result(scalars, {}, rubber)


def make_dimensionless_rubber_result(
    scalars: dict[str, float], curves: dict[str, npt.NDArray[Any]], rubber: NeoHookeanBody
) -> Result:
    """Make a result of dimensionless scalars, which are converted to float, and of curves.

    Args:
        scalars: Scalars by name.
        curves: Arrays by name.
        rubber: Body that gives the number of unknowns.
    """
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(
        numbers, assign_unit_one_to_scalars(numbers), curves, dofs=len(rubber.solution.x.array)
    )
