"""Known answers of contact at large strains: even compression and shear, and Hertz's limit."""

from functools import partial

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.optimize import brentq

from pw_elements import prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, Motion, Plane, Sphere
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_lines import growing
from study.meshes.solid_meshes import box
from study.model.units import dimensionless
from study.run.store import Result
from study.verification.v16_rubber import RATIO, Array, Rubber, Run, follow

Mask = npt.NDArray[np.bool_]

LAME = 2 * RATIO / (1 - 2 * RATIO)
SQUEEZED, SLID, PARTS = 0.4, 0.5, 2  # of the height, in increments
ROUGH = 2.0  # friction that sticks
# Hertz: elements over the half width of contact, which is one, and the block's extent
ACROSS, EXTENT, GROWTH = 8, 24.0, 1.35
INNER = 0.8  # of the half width, where pressures are compared


def compressed(element: str) -> Result:
    """A cube that may widen, below a smooth plate: its stretches are known, and so are forces."""
    rubber = _cube(element)
    dim, space, height = rubber.dim, rubber.w.function_space, 1 - SQUEEZED
    held = [prescribe(space, k, partial(_on_plane, axis=k)) for k in range(dim)]

    def stretched(s: float) -> Array:
        return np.diag([*[s] * (dim - 1), height])

    across = brentq(lambda s: _stress(stretched(s))[0, 0], 0.8, 2.0, xtol=1e-15)
    plate = ContactPair(lambda x: np.isclose(x[dim - 1], 1), _plate(dim))
    motions = [_moved(dim, 0.0, k / PARTS) for k in range(1, PARTS + 1)]
    run = follow(rubber, plate, held, motions, np.isclose(rubber.x[:, -1], 0))
    return _compared(rubber, run, stretched(across))


def sheared(element: str) -> Result:
    """A cube whose sides follow an even shear and compression, below a plate that sticks to it."""
    rubber = _cube(element)
    dim, space = rubber.dim, rubber.w.function_space
    F = np.eye(dim)
    F[-1, -1], F[0, -1] = 1 - SQUEEZED, SLID
    x = rubber.x
    sides = (np.isclose(x, 0) | np.isclose(x, 1))[:, : dim - 1].any(axis=1) | np.isclose(
        x[:, -1], 0
    )
    given, nodes = fem.Function(space), np.flatnonzero(sides).astype(np.int32)

    def above(x: Array) -> Mask:
        inside = ((x[: dim - 1] > 1e-9) & (x[: dim - 1] < 1 - 1e-9)).all(axis=0)
        return np.asarray(np.isclose(x[dim - 1], 1) & inside)

    def loading(k: int, share: float) -> None:
        given.x.array[:] = (k + share) / PARTS * (x @ (F - np.eye(dim)).T).ravel()

    plate = ContactPair(above, _plate(dim), friction=ROUGH)
    motions = [_moved(dim, SLID * k / PARTS, k / PARTS) for k in range(1, PARTS + 1)]
    base = np.isclose(x[:, -1], 0) | sides
    run = follow(rubber, plate, [fem.dirichletbc(given, nodes)], motions, base, loading)
    return _compared(rubber, run, F)


def hertz(element: str, radius: float) -> Result:
    """A cylinder pressed by the force of Hertz's half width of one: small strains in the limit."""
    size = 1 / ACROSS
    near = np.linspace(-2, 2, 4 * ACROSS + 1)
    far = 2 + growing(size, EXTENT - 2, GROWTH)[1:]
    lines = np.concatenate([-far[::-1], near, far])
    depths = -growing(size, EXTENT, GROWTH)[::-1]
    rubber = Rubber(element, on_lines(MPI.COMM_SELF, lines, depths, "triangle"))
    space = rubber.w.function_space

    def below(x: Array) -> Mask:
        return np.asarray(np.isclose(x[1], -EXTENT))

    held = [prescribe(space, axis, below) for axis in (0, 1)]
    modulus = 2 / (1 - RATIO)  # of plane strain, over the shear modulus
    force, peak = np.pi * modulus / (4 * radius), modulus / (2 * radius)
    pair = ContactPair(
        lambda x: np.isclose(x[1], 0) & (np.abs(x[0]) < 1.9), Sphere((0.0, radius), radius)
    )
    motions = [Motion((0.0, -0.5 / radius)), Motion((0.0, None), force=(0.0, -force))]
    run = follow(rubber, pair, held, motions, below(rubber.x.T))
    last = run.states[-1].pairs[0]
    true = last.force_normal / rubber.areas(last.node)[1]
    place = (last.position + last.displacement)[:, 0]
    inner = np.abs(last.position[:, 0]) < INNER
    exact = peak * np.sqrt(1 - np.where(inner, place, 0.0) ** 2)
    error = (true - exact)[inner] / peak
    scalars = {
        "pressure_rms": float(np.sqrt(np.mean(error**2))),
        "peak_over_hertz": float(true.max() / peak),
        "balance": float(abs(last.force[1] + force) / force),
        "base_defect": run.base_defect(),
    }
    curves = {"x": place, "pressure": true / peak}
    return Result(scalars, dimensionless(scalars), curves, dofs=len(rubber.w.x.array))


def _on_plane(x: Array, axis: int) -> Mask:
    return np.asarray(np.isclose(x[axis], 0))


def _cube(element: str) -> Rubber:
    plane = element.endswith("T6")
    lines: Array = np.linspace(0.0, 1.0, 4 if plane else 3, dtype=np.float64)
    if plane:
        return Rubber(element, on_lines(MPI.COMM_SELF, lines, lines, "triangle"))
    return Rubber(element, box("tetrahedron", lines, lines, lines))


def _plate(dim: int) -> Plane:
    """At height one, pressing downwards."""
    axis = np.eye(dim)[-1]
    return Plane(tuple(axis), tuple(-axis))


def _moved(dim: int, aside: float, share: float) -> Motion:
    return Motion((aside, *[0.0] * (dim - 2), -SQUEEZED * share))


def _stress(F: Array) -> Array:
    """First Piola-Kirchhoff's, by hand; plane strain in the plane."""
    inverse = np.linalg.inv(F).T
    return F - inverse + LAME * np.log(np.linalg.det(F)) * inverse


def _compared(rubber: Rubber, run: Run, F: Array) -> Result:
    """Forces and displacements against an even deformation."""
    pair = run.states[-1].pairs[0]
    traction = _stress(F)[:, -1]
    nominal, true = rubber.areas(pair.node)
    expected = nominal[:, None] * traction
    size = np.abs(expected).max()
    even = rubber.x @ (F - np.eye(rubber.dim)).T
    stretch = np.linalg.det(F) * np.linalg.norm(np.linalg.inv(F).T[:, -1])
    scalars = {
        "force_error": np.abs(pair.force_vector - expected).max() / size,
        "displacement_error": np.abs(rubber.displacement - even).max(),
        "area_error": np.abs(true / nominal - stretch).max(),
        "base_defect": run.base_defect([*range(rubber.dim)]),
        "sticking": np.mean(pair.status == STICK),
        "closed": np.mean(pair.status != OPEN),
        "pressure": -traction[-1],
        "shear": traction[0],
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), {}, dofs=len(rubber.w.x.array))
