"""Contact at large strains with known answers: uniform deformations, and the limit of Hertz."""

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
from study.meshes.mesh_lines import growing_lines
from study.meshes.solid_meshes import mesh_box
from study.model.units import dimensionless
from study.run.store import Result
from study.solutions.rubber import (
    POISSONS_RATIO,
    Array,
    LoadHistory,
    RubberBody,
    lame_over_shear,
    solve_tool_motions,
)

Mask = npt.NDArray[np.bool_]

DEGREE = {2: 4, 3: 2}
"""Degree of quadrature by dimension, for all problems of the section."""
PLATE_COMPRESSION, PLATE_SHEAR = 0.4, 0.5
"""Downward and sideways motion of the plate over the height of the cube."""
N_INCREMENTS = 2
STICKING_FRICTION = 2.0
"""Coefficient of friction that is large enough to prevent slip."""

# Hertz's limit: lengths relative to the half width of contact
HERTZ_ELEMENTS = 8
"""Elements over the half width of contact."""
HERTZ_EXTENT, HERTZ_GROWTH = 24.0, 1.35
"""Depth and half width of the block, and growth ratio of its elements outside the contact."""
INNER_RADIUS = 0.8
"""Distance from the middle, over the half width, within which pressures are compared."""


def compressed(element: str) -> Result:
    """Compress a cube, free to widen, by a smooth plate; return errors of forces and displacements."""
    rubber = _make_cube(element)
    dim, space, height = rubber.dim, rubber.solution.function_space, 1 - PLATE_COMPRESSION
    supports = [prescribe(space, k, partial(_is_on_plane, axis=k)) for k in range(dim)]

    def deformation(lateral_stretch: float) -> Array:
        return np.diag([*[lateral_stretch] * (dim - 1), height])

    lateral_stretch = brentq(
        lambda s: _piola_kirchhoff_stress(deformation(s))[0, 0], 0.8, 2.0, xtol=1e-15
    )
    plate = ContactPair(lambda x: np.isclose(x[dim - 1], 1), _make_rigid_plate(dim))
    motions = [_plate_motion(dim, 0.0, k / N_INCREMENTS) for k in range(1, N_INCREMENTS + 1)]
    history = solve_tool_motions(rubber, plate, supports, motions, np.isclose(rubber.x[:, -1], 0))
    return _compare_with_uniform_deformation(rubber, history, deformation(lateral_stretch))


def sheared(element: str) -> Result:
    """Shear and compress a cube by a sticking plate; its sides follow the uniform deformation."""
    rubber = _make_cube(element)
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

    def set_supports(k: int, load_factor: float) -> None:
        fraction = (k + load_factor) / N_INCREMENTS
        prescribed.x.array[:] = fraction * (x @ (F - np.eye(dim)).T).ravel()

    plate = ContactPair(is_below_plate, _make_rigid_plate(dim), friction=STICKING_FRICTION)
    motions = [
        _plate_motion(dim, PLATE_SHEAR * k / N_INCREMENTS, k / N_INCREMENTS)
        for k in range(1, N_INCREMENTS + 1)
    ]
    supports = [fem.dirichletbc(prescribed, nodes)]
    history = solve_tool_motions(rubber, plate, supports, motions, is_held, set_supports)
    return _compare_with_uniform_deformation(rubber, history, F)


def hertz(element: str, radius: float) -> Result:
    """Press a cylinder with the force for which Hertz's half width of contact is one.

    Strains become small as the radius grows.
    """
    size = 1 / HERTZ_ELEMENTS
    near = np.linspace(-2, 2, 4 * HERTZ_ELEMENTS + 1)
    far = 2 + growing_lines(size, HERTZ_EXTENT - 2, HERTZ_GROWTH)[1:]
    lines = np.concatenate([-far[::-1], near, far])
    depths = -growing_lines(size, HERTZ_EXTENT, HERTZ_GROWTH)[::-1]
    mesh = mesh_along_lines(MPI.COMM_SELF, lines, depths, "triangle")
    rubber = RubberBody(element, mesh, DEGREE[2])
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
    history = solve_tool_motions(rubber, pair, supports, motions, is_base(rubber.x.T))
    last = history.states[-1].pairs[0]
    pressure = last.force_normal / rubber.weight_areas(last.node)[1]
    position = (last.position + last.displacement)[:, 0]
    is_inner = np.abs(last.position[:, 0]) < INNER_RADIUS
    exact = peak * np.sqrt(1 - np.where(is_inner, position, 0.0) ** 2)
    error = (pressure - exact)[is_inner] / peak
    scalars = {
        "pressure_rms": float(np.sqrt(np.mean(error**2))),
        "peak_over_hertz": float(pressure.max() / peak),
        "balance": float(abs(last.force[1] + force) / force),
        "base_defect": history.max_relative_imbalance(),
    }
    curves = {"x": position, "pressure": pressure / peak}
    return make_rubber_result(scalars, curves, rubber)


def _is_on_plane(x: Array, axis: int) -> Mask:
    return np.asarray(np.isclose(x[axis], 0))


def _make_cube(element: str) -> RubberBody:
    is_plane = element.endswith("T6")
    lines: Array = np.linspace(0.0, 1.0, 4 if is_plane else 3, dtype=np.float64)
    if is_plane:
        mesh = mesh_along_lines(MPI.COMM_SELF, lines, lines, "triangle")
        return RubberBody(element, mesh, DEGREE[2])
    return RubberBody(element, mesh_box("tetrahedron", lines, lines, lines), DEGREE[3])


def _make_rigid_plate(dim: int) -> Plane:
    """Return a rigid plate at height one that presses downwards."""
    up = np.eye(dim)[-1]
    return Plane(tuple(up), tuple(-up))


def _plate_motion(dim: int, sideways: float, compression_factor: float) -> Motion:
    return Motion((sideways, *[0.0] * (dim - 2), -PLATE_COMPRESSION * compression_factor))


def _piola_kirchhoff_stress(F: Array) -> Array:
    """Return the first Piola-Kirchhoff stress of F over the shear modulus, in plane strain."""
    inverse = np.linalg.inv(F).T
    return F - inverse + lame_over_shear(POISSONS_RATIO) * np.log(np.linalg.det(F)) * inverse


def _compare_with_uniform_deformation(rubber: RubberBody, history: LoadHistory, F: Array) -> Result:
    """Return errors of forces and displacements against those of a uniform deformation F."""
    pair = history.states[-1].pairs[0]
    traction = _piola_kirchhoff_stress(F)[:, -1]
    undeformed_area, deformed_area = rubber.weight_areas(pair.node)
    expected = undeformed_area[:, None] * traction
    largest_force = np.abs(expected).max()
    exact_displacement = rubber.x @ (F - np.eye(rubber.dim)).T
    area_stretch = np.linalg.det(F) * np.linalg.norm(np.linalg.inv(F).T[:, -1])
    scalars = {
        "force_error": np.abs(pair.force_vector - expected).max() / largest_force,
        "displacement_error": np.abs(rubber.displacement - exact_displacement).max(),
        "area_error": np.abs(deformed_area / undeformed_area - area_stretch).max(),
        "base_defect": history.max_relative_imbalance([*range(rubber.dim)]),
        "sticking": np.mean(pair.status == STICK),
        "closed": np.mean(pair.status != OPEN),
        "pressure": -traction[-1],
        "shear": traction[0],
    }
    return make_rubber_result(scalars, {}, rubber)


def make_rubber_result(
    scalars: dict[str, float], curves: dict[str, npt.NDArray[Any]], rubber: RubberBody
) -> Result:
    """Return a result of dimensionless scalars (converted to float) and curves."""
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=len(rubber.solution.x.array))
