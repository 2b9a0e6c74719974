"""Impact: an elastic bar on a rigid wall, by central differences with four pairs (K, M).

A bar in uniaxial strain hits the wall with its end face at the speed 1. Density and speed of
sound are one, so that the face has the pressure 1 until the wave comes back from the other end,
at the time 8; then the bar flies off at the speed 1.
"""

from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, create_unit_cube
from scipy.sparse.linalg import eigs

from pw_elements import (
    Body,
    Material,
    Reduction,
    Sibling,
    Spaces,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    critical_step,
    force_transfer,
    lumped_mass,
    prescribe,
    vibration_modes,
)
from pw_elements.contact import ContactPair, Plane, solve_impact
from pw_elements.elasticity import StressState, order_by_position
from study.meshes.mesh_families import (
    cell_size,
    on_bar,
    on_cube,
    on_square,
    on_strip,
    order,
)
from study.model.reading import compared, transferred
from study.model.units import dimensionless
from study.run.cases import Case, mark_costly
from study.run.store import Result

SECTION = "V12"
TITLE = "Impact and the symmetric sibling"

Array = npt.NDArray[np.float64]

POISSONS_RATIO = 0.3
# With which the speed of sound in uniaxial strain is one
YOUNGS_MODULUS = (1 + POISSONS_RATIO) * (1 - 2 * POISSONS_RATIO) / (1 - POISSONS_RATIO)
MATERIAL = Material(YOUNGS_MODULUS, POISSONS_RATIO)
STATES = {2: StressState.PLANE_STRAIN, 3: StressState.SOLID}
COURANT = 0.9  # step over the critical one, the library's own
END = 9.0  # the exact release is at 8
LATE = 100.0  # of the longest runs
STEADY = (1.0, 7.0)  # times between which pressures count
IN_CONTACT = 0.05  # total force over the exact one that counts as contact


@dataclass(frozen=True)
class Scheme:
    """A stiffness with a lumped mass.

    Args:
        body: spaces and material.
        K: stiffness, free.
        M: mass, diagonal.
        sibling: where the unknowns are its coefficients.
    """

    body: Body
    K: PETSc.Mat
    M: PETSc.Mat
    sibling: Sibling | None = None

    @classmethod
    def of(cls, name: str, mesh: Mesh) -> "Scheme":
        """One of `SCHEMES` on a mesh."""
        state = STATES[mesh.topology.dim]
        standard = Body(Spaces.galerkin(mesh), MATERIAL, state)
        new = Body(Spaces.petrov_galerkin(mesh), MATERIAL, state)
        if name == "pw":
            return cls(new, assemble_matrix(new.stiffness()), _lumped(new))
        K, space = assemble_matrix(standard.stiffness()), standard.spaces.trial
        if name == "hrz":
            return cls(standard, K, _hrz(space))
        if name == "standard-pwmass":
            return cls(standard, K, _lumped(new))
        sibling = Sibling.from_space(space)
        if name == "sibling-pwmass":
            return cls(standard, sibling.matrix(K), _lumped(new), sibling)
        M = lumped_mass(sibling.matrix(assemble_matrix(standard.mass())), space)
        return cls(standard, sibling.matrix(K), M, sibling)

    @property
    def space(self) -> fem.FunctionSpace:
        """Trial space."""
        return self.body.spaces.trial

    def walls(self, lengths: list[float]) -> Reduction:
        """Smooth rigid walls on both sides across each of the first axes."""
        conditions = [
            prescribe(self.space, axis, _on(axis, end))
            for axis, length in enumerate(lengths)
            for end in (0.0, length)
        ]
        if self.sibling is not None:
            return self.sibling.dirichlet(conditions)
        return Reduction.dirichlet(self.space, conditions)


@dataclass(frozen=True)
class Motion:
    """The motion of the bar.

    Args:
        time: (s,), at which the forces act.
        force: (s, m), of the wall on the nodes of the face, sorted by their positions.
        energy: at the end over that at the start.
        critical_step: the largest that is stable.
    """

    time: Array
    force: Array
    energy: float
    critical_step: float


def bar(scheme: str, dimension: int, cells: int, end: float = END) -> Result:
    """A bar 4 long and 1 wide on a rigid wall, `cells` along its width.

    Pressures and forces are means over the steady time at nodes inside the face. Pressures are read
    by own weights; errors are `common` at nodes where the standard element has one, and `alone` at
    others. Forces are over their mean. `open_share` is that of pairs of a node and a step at which
    the node does not touch.
    """
    build = {2: on_strip, 3: on_bar}[dimension]
    mesh = build("", 1 / cells)
    found = Scheme.of(scheme, mesh)
    held = found.walls([1.0] * (dimension - 1))
    motion = (_by_hand if scheme == "pw" else _by_library)(found, held, end)
    wall = _on(dimension - 1, 0.0)
    face = SurfaceNodes.from_body(found.body, wall)
    if found.sibling is not None:
        face = transferred(face, force_transfer(found.space))
    standard = Body(Spaces.galerkin(mesh), MATERIAL, STATES[dimension])
    total = motion.force.sum(axis=1)  # the exact one is 1, as the face's area
    steady = (motion.time > STEADY[0]) & (motion.time < STEADY[1])
    inner = motion.force[steady][:, ~face.rim]
    mean = inner.mean(axis=0)
    pressure = face.pressure(motion.force[steady].mean(axis=0))[~face.rim]
    of_standard = SurfaceNodes.from_body(standard, wall).pressure(face.weight_area)[~face.rim]
    errors = compared(pressure - 1, of_standard)
    scalars = {
        "pressure_min": np.nanmin(pressure),
        "pressure_max": np.nanmax(pressure),
        "pressure_error_max": np.nanmax(np.abs(pressure - 1)),
        **{f"pressure_error_{of}": size for of, size in errors.items()},
        "force_min": mean.min() / mean.mean(),
        "force_max": mean.max() / mean.mean(),
        "open_share": np.mean(inner == 0),
        "open_share_common": np.mean(inner[:, ~np.isnan(of_standard)] == 0),
        "release_time": motion.time[total > IN_CONTACT].max(),
        "energy_end": motion.energy,
        "critical_step": motion.critical_step,
        "critical_step_over_h": motion.critical_step * cells,
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    curves = {
        "time": motion.time,
        "total": total,
        "pressure": pressure,
        "force": mean,
        "x": face.position[~face.rim],
    }
    return Result(numbers, dimensionless(numbers), curves, dofs=found.K.getSize()[0])


def frequency(scheme: str, dimension: int, cells: tuple[int, ...]) -> Result:
    """The lowest omega^2 of a unit square or cube between smooth walls: 2 pi^2 c_s^2, shear.

    Scalars of the finest mesh, and the order in the size of cells. `acceleration_min` and `_max`
    are those of nodes under an even body force of one, without supports.
    """
    exact = 2 * np.pi**2 * (1 - 2 * POISSONS_RATIO) / (2 * (1 - POISSONS_RATIO))
    build = {2: on_square, 3: on_cube}[dimension]
    sizes, errors = [], []
    for n in cells:
        mesh = build("T6", 1 / n)
        found = Scheme.of(scheme, mesh)
        held = found.walls([1.0] * dimension)
        modes = vibration_modes(found.K, found.M, held, 1)
        sizes.append(cell_size(mesh))
        errors.append(modes.eigenvalues[0] / exact - 1)
    acceleration = _fall(found)
    scalars = {
        "acceleration_min": acceleration.min(),
        "acceleration_max": acceleration.max(),
        "omega2_error": errors[-1],
        "order": order(np.array(sizes), np.abs(errors)),
        "residual": modes.residuals[0],
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    curves = {"size": np.array(sizes), "error": np.array(errors)}
    return Result(numbers, dimensionless(numbers), curves, dofs=found.K.getSize()[0])


def regular_step(scheme: str, cells: int) -> Result:
    """Critical step of a free unit cube whose small cubes are all cut alike."""
    found = Scheme.of(scheme, create_unit_cube(MPI.COMM_SELF, cells, cells, cells))
    free = Reduction.dirichlet(found.space, [])
    scalars = {"critical_step_over_h": critical_step(found.K, found.M, free) * cells}
    return Result(scalars, dimensionless(scalars), {}, dofs=found.K.getSize()[0])


def _by_library(found: Scheme, held: Reduction, end: float = END) -> Motion:
    dim = found.body.spaces.mesh.geometry.dim
    axis = np.eye(dim)[-1]
    wall = ContactPair(_on(dim - 1, 0.0), Plane((0.0,) * dim, tuple(axis)))
    history = solve_impact(found.K, found.M, held, wall, found.space, end, _thrown(found))
    energy = history.energies.total
    return Motion(
        history.time[:-1],
        history.pairs[0].force @ axis,
        energy[-1] / energy[0],
        history.critical_step,
    )


def _by_hand(found: Scheme, held: Reduction, end: float = END) -> Motion:
    """Central differences with contact for any stiffness: what the library refuses to do."""
    K, mass, free = _free(found, held)
    dim = found.body.spaces.mesh.geometry.dim
    nodes = fem.locate_dofs_geometrical(found.space, _on(dim - 1, 0.0))
    nodes = nodes[order_by_position(found.space.tabulate_dof_coordinates()[nodes, :dim])]
    rows = np.searchsorted(free, dim * nodes + dim - 1)
    critical = 2 / np.sqrt(abs(_highest(K, mass)))
    dt = COURANT * critical
    steps = int(np.ceil(end / dt))
    v = _thrown(found).array_r[free]
    u, inner, forces, start = np.zeros(len(free)), np.zeros(len(free)), [], mass * v @ v / 2
    for _ in range(steps):
        v = v - dt * inner / mass
        depth = np.maximum(0.0, -(u + dt * v)[rows])
        v[rows] += depth / dt
        forces.append(mass[rows] * depth / dt**2)
        before, u = u, u + dt * v
        inner = K @ u
    energy = (mass * v @ v + before @ inner) / 2 / start
    return Motion(dt * np.arange(steps, dtype=np.float64), np.array(forces), energy, critical)


def _fall(found: Scheme) -> Array:
    """Accelerations of the nodes under an even body force of one."""
    dim = found.body.spaces.mesh.geometry.dim
    load = assemble_vector(found.body.body_load(np.eye(dim)[-1]))
    if found.sibling is not None:
        load = found.sibling.load(load)
    return np.asarray((load.array_r / found.M.getDiagonal().array_r)[dim - 1 :: dim])


def _free(found: Scheme, held: Reduction) -> tuple[sp.csr_matrix, Array, npt.NDArray[np.intp]]:
    """Stiffness, masses and numbers of the free unknowns."""
    indptr, _, _ = held.right.getValuesCSR()
    free = np.flatnonzero(np.diff(indptr))
    indptr, indices, values = found.K.getValuesCSR()
    K = sp.csr_matrix((values, indices, indptr))[free][:, free]
    return K, found.M.getDiagonal().array_r[free], free


def _highest(K: sp.csr_matrix, mass: Array) -> complex:
    """Eigenvalue of largest size of M^-1 K."""
    start = np.cos(np.arange(len(mass)))
    return complex(eigs(sp.diags(1 / mass) @ K, k=1, v0=start, return_eigenvectors=False)[0])


def _thrown(found: Scheme) -> PETSc.Vec:
    """Velocities of the bar that flies towards the wall, coefficients being the same."""
    velocity = found.K.createVecRight()
    dim = found.body.spaces.mesh.geometry.dim
    velocity.setArray(np.tile(-np.eye(dim)[-1], velocity.getLocalSize() // dim))
    return velocity


def _lumped(body: Body) -> PETSc.Mat:
    return lumped_mass(assemble_matrix(body.mass()), body.spaces.trial)


def _hrz(space: fem.FunctionSpace) -> PETSc.Mat:
    """Lumped mass of Hinton, Rock and Zienkiewicz: the diagonal, scaled to each cell's mass.

    Of straight cells with the density one. DOI 10.1002/eqe.4290040305.
    """
    element = space.element.basix_element
    points, weights = basix.make_quadrature(element.cell_type, 4)
    diagonal = weights @ element.tabulate(0, points)[0, :, :, 0] ** 2
    cells = fem.functionspace(space.mesh, ("DG", 0))
    volume = fem.assemble_vector(fem.form(ufl.TestFunction(cells) * ufl.dx)).array
    shares = np.outer(volume, diagonal / diagonal.sum())
    mass = np.bincount(space.dofmap.list.ravel(), shares.ravel())
    M = PETSc.Mat().createAIJ([len(mass) * space.dofmap.index_map_bs] * 2, nnz=1)
    M.setDiagonal(PETSc.Vec().createWithArray(np.repeat(mass, space.dofmap.index_map_bs)))
    M.assemble()
    return M


def _on(axis: int, value: float) -> Callable[[Array], npt.NDArray[np.bool_]]:
    return lambda x: np.isclose(x[axis], value)


STANDARD, SIBLING, NEW = "galerkin", "sibling", "pw"
SCHEMES = {
    "hrz": STANDARD,
    "standard-pwmass": STANDARD,
    "sibling": SIBLING,
    "sibling-pwmass": SIBLING,
    "pw": NEW,
}
"""Schemes, and the elements that they are made of."""
BARS = {2: (4, 8, 16), 3: (3, 5, 7)}
CUBES = {2: (8, 16, 32), 3: (5, 7, 9)}


SHAPES = {2: ("square", "T6"), 3: ("cube", "T10")}


def _schemes(dimension: int) -> list[str]:
    """Without one of the two sibling's masses that are the same in the plane."""
    return [name for name in SCHEMES if dimension == 3 or name != "sibling-pwmass"]


def _bar(scheme: str, dimension: int, cells: int, end: float = END) -> Case:
    late = f"-{end:.0f}" if end != END else ""
    stated = {"scheme": scheme, "dimension": dimension, "cells": cells, "end": end}
    implied = {"element": f"{SCHEMES[scheme]}-{SHAPES[dimension][1]}"}
    return Case("V12", f"bar-{dimension}d-{scheme}-{cells}{late}", bar, stated, implied)


def _frequency(scheme: str, dimension: int, cells: tuple[int, ...], suffix: str = "") -> Case:
    shape, cell = SHAPES[dimension]
    stated = {"scheme": scheme, "dimension": dimension, "cells": cells}
    implied = {"element": f"{SCHEMES[scheme]}-{cell}"}
    return Case("V12", f"frequency-{shape}-{scheme}{suffix}", frequency, stated, implied)


CASES = [
    case
    for dimension in SHAPES
    for scheme in _schemes(dimension)
    for case in (
        *(_bar(scheme, dimension, n) for n in BARS[dimension]),
        _frequency(scheme, dimension, CUBES[dimension]),
    )
]
CASES += [
    Case(
        "V12",
        f"step-cube-{scheme}",
        regular_step,
        {"scheme": scheme, "cells": 4},
        {"element": f"{SCHEMES[scheme]}-T10"},
    )
    for scheme in ("hrz", "sibling", "sibling-pwmass")
]
CASES = mark_costly(CASES, "*-3d-*-7", "*-3d-sibling-pwmass-*", "frequency-cube-sibling-pwmass")
CASES += mark_costly(
    [
        *(_bar(scheme, 2, n) for scheme in ("hrz", "sibling") for n in (32, 64)),
        *(_bar(scheme, 3, n) for scheme in ("hrz", "sibling") for n in (10, 14, 20)),
        *(_bar(scheme, d, n, LATE) for scheme in ("hrz", "sibling") for d, n in ((2, 16), (3, 5))),
        *(
            _frequency(scheme, d, cells, "-fine")
            for scheme in ("hrz", "sibling")
            for d, cells in ((2, (32, 64, 128)), (3, (9, 12, 16)))
        ),
    ]
)
