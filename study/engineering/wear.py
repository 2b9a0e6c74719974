"""Archard's wear of an elastic punch on a rigid plate that slides across its plane.

The punch is a block 2 wide (in space 2 x 2) and 1 high, on whose back an even load acts in the
middle, |x| < 1/2 (and |y|). Its face wears by k p a unit of path, at nodes, explicitly. Lengths are
over the punch's height, stresses over the mean pressure. Wear goes on until
pressures are even: the end is known.

A step of the path is stable while k ds times the largest eigenvalue of R S is below 2, where R
reads pressures and S is the change of forces with depths while all of the face touches. Steps are
as many as the finest meshes need.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import (
    Body,
    Material,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from study.engineering.readings import reading as read_by
from study.meshes.solid_meshes import box, cell_of
from study.model.discretisation import spaces
from study.rivals.problem import direct

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]

MODULUS, NU, MEAN = 100.0, 0.3, 1.0  # the last is the mean pressure
PATH = 0.06  # k s, the mean depth at the end
LOADED = 0.5  # part of the back that is loaded
CIRCLES, MOST = 10, 2000  # changes of the set of touching nodes
ROUND_OFF = 1e-12  # of forces over the whole, and of gaps


@dataclass(frozen=True)
class Punch:
    """The punch on one element, condensed to the normal displacements of its face's nodes.

    Args:
        surface: the face, m nodes.
        flexibility: (m, m), displacements by nodal forces, less a translation.
        free: (m,), displacements by the load, less a translation.
        force: on this half or quarter.
        dofs: unknowns.
    """

    surface: SurfaceNodes
    flexibility: Array
    free: Array
    force: float
    dofs: int

    @classmethod
    def of(cls, element: str, cells: int) -> "Punch":
        """One half, or in space a quarter, with `cells` along its height and half width."""
        lines: npt.NDArray[np.float64] = np.linspace(0.0, 1.0, cells + 1, dtype=np.float64)
        if element.endswith("T6"):
            mesh, state = triangles(MPI.COMM_SELF, (0, 0), (1, 1), (cells, cells)), "plane strain"
        else:
            mesh, state = box(cell_of(element), lines, lines, lines), "solid"
        up = mesh.geometry.dim - 1
        body = Body(spaces(element, mesh), Material(MODULUS, NU), StressState(state))
        K, space = assemble_matrix(body.stiffness()), body.spaces.trial

        def back(x: Array) -> Mask:
            loaded = np.max(x[:up], axis=0) < LOADED + 1e-9
            return np.asarray(np.isclose(x[up], 1.0) & loaded)

        def top(x: Array) -> Mask:  # one node: held against a translation, it has no reaction
            return np.asarray(np.isclose(x, np.eye(3)[up][:, None]).all(axis=0))

        down = -MEAN * np.eye(up + 1)[up] / LOADED**up
        load = assemble_vector(body.surface_load(down, boundary_measure(mesh, back))).array
        held = [prescribe(space, i, _symmetry(i)) for i in range(up)]
        held.append(prescribe(space, up, top))
        free = np.setdiff1d(np.arange(len(load)), [d for bc in held for d in bc.dof_indices()[0]])

        def face(x: Array) -> Mask:
            return np.isclose(x[up], 0.0)

        surface = SurfaceNodes.from_body(body, face)
        rows = np.searchsorted(free, (up + 1) * surface.node + up)
        right = np.zeros((len(free), len(rows) + 1))
        right[rows, np.arange(len(rows))] = 1.0
        right[:, -1] = load[free]
        moved = _solved(K, free, right)[rows]
        pressing = -load[up :: up + 1].sum()
        return cls(surface, moved[:, :-1], moved[:, -1], float(pressing), len(load))

    def forces(self, depth: Array, touching: Mask) -> tuple[Array, Mask]:
        """Nodal forces (m,) on a face that is worn to depths (m,), and which nodes touch.

        All nodes that violate the law change; if that goes in circles, the first of them alone,
        which ends for every stiffness whose principal minors are positive (K. G. Murty, 1974).

        Raises:
            RuntimeError: if it does not.
        """
        for count in range(MOST):
            on = np.flatnonzero(touching)
            border = np.ones((len(on), 1))
            system = np.block(
                [[self.flexibility[np.ix_(on, on)], border], [border.T, np.zeros((1, 1))]]
            )
            right = np.append(-(depth + self.free)[on], self.force)
            solution = np.linalg.solve(system, right)
            found = np.zeros(len(depth))
            found[on] = solution[:-1]
            gap = depth + self.free + self.flexibility @ found + solution[-1]
            now = np.where(touching, found >= -ROUND_OFF * self.force, gap < -ROUND_OFF)
            wrong = np.flatnonzero(now != touching)
            if not len(wrong):
                return found, touching
            if count > CIRCLES:
                wrong = wrong[:1]
            touching = touching.copy()
            touching[wrong] = ~touching[wrong]
        raise RuntimeError("no set of touching nodes is found")

    def stiffness(self) -> Array:
        """Change of forces (m, m) with depths while all nodes touch, with its sign changed."""
        m = len(self.free)
        return np.asarray(np.linalg.inv(self._system(np.arange(m)))[:m, :m])

    def _system(self, on: npt.NDArray[np.int64]) -> Array:
        """Nodes that lie on the plate, moved by forces and a translation; the sum of forces."""
        border = np.ones((len(on), 1))
        flexible = self.flexibility[np.ix_(on, on)]
        return np.block([[flexible, border], [border.T, np.zeros((1, 1))]])


def _symmetry(axis: int) -> Callable[[Array], Mask]:
    return lambda x: np.isclose(x[axis], 0.0)


def _solved(K: PETSc.Mat, free: npt.NDArray[np.int64], right: Array) -> Array:
    """Solutions (n, k) by MUMPS of the free rows and columns."""
    rows = PETSc.IS().createGeneral(free.astype(PETSc.IntType))
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K.createSubMatrix(rows, rows))
    direct(ksp)
    ksp.setUp()
    B = PETSc.Mat().createDense(right.shape, array=right)
    B.assemble()
    X = B.duplicate()
    ksp.pc.getFactorMatrix().matSolve(B, X)
    return np.array(X.getDenseArray())


class Worn(NamedTuple):
    """What becomes of the punch.

    Args:
        punch: it.
        half: depths (m,) at half of the path.
        depth: depths at the end.
        pressure: pressures at the end, as they are read.
        step_over_bound: the step over the largest that is stable.
        volume_error: of the worn volume by the reading's own weights, over k x force x path.
        end_error: largest distance of pressures at the end from the mean one, by own weights or,
            where these vanish, projected.
    """

    punch: Punch
    half: Array
    depth: Array
    pressure: Array
    step_over_bound: float
    volume_error: float
    end_error: float


def worn(element: str, reading: str, cells: int, steps: int) -> Worn:
    """The face after so many equal steps of the path.

    Raises:
        ValueError: for a step that is not stable.
    """
    punch = Punch.of(element, cells)
    R = read_by(reading, punch.surface)
    step = PATH / steps
    over = step * float(np.abs(np.linalg.eigvals(R @ punch.stiffness())).max()) / 2
    if over >= 1:
        raise ValueError(f"{steps} steps are not stable: it takes {int(np.ceil(steps * over))}")
    depth: Array = np.zeros(len(R))
    touching: Mask = np.ones(len(R), dtype=bool)
    half = depth
    for k in range(steps):
        force, touching = punch.forces(depth, touching)
        depth = depth + step * np.maximum(0.0, R @ force)
        half = depth if k == steps // 2 - 1 else half
    force, _ = punch.forces(depth, touching)
    surface = punch.surface
    weights = surface.tributary_area if reading == "tributary" else surface.weight_area
    best = "own" if surface.weight_area.min() > 1e-9 * surface.tributary_area.min() else "projected"
    volume_error = abs(weights @ depth / (punch.force * PATH) - 1)
    end_error = np.abs(read_by(best, surface) @ force / MEAN - 1).max()
    return Worn(punch, half, depth, R @ force, over, float(volume_error), float(end_error))
