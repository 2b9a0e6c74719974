"""Explicit dynamics with the positive lumped mass: which stiffness it may be combined with.

A clamped square vibrates freely after its weight is taken away. Central differences multiply the
part of an eigenvalue w by factors rho with rho^2 - (2 - dt^2 w) rho + 1 = 0, whose product is one:
unless w is real and dt^2 w <= 4, one of them is larger, and that part grows.
"""

from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.linalg
from dolfinx.mesh import Mesh

from pw_elements import (
    Body,
    Material,
    Reduction,
    Sibling,
    Spaces,
    assemble_matrix,
    assemble_vector,
    lumped_mass,
    prescribe,
    solve,
)
from pw_elements.algebra import symmetric_part
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes, triangles
from study.meshes.distortion import smooth_distortion
from study.model.matrices import dense
from study.model.units import dimensionless
from study.run.cases import Case
from study.run.store import Result

SECTION = "V9"
TITLE = "Explicit dynamics with lumped mass"

Array = npt.NDArray[np.float64]

# E, the density and the square's side are one: all numbers are dimensionless
MATERIAL = Material(1.0, 0.3)
COURANT = 0.5  # time step over the largest one that is stable for real eigenvalues
PERIODS = 10  # of the slowest mode


def pair(matrices: str, squares: int, regular: bool = False) -> Result:
    """All eigenvalues of a pair (K, M) on a clamped square, and its free vibration.

    Args:
        matrices: a name of `PAIRS`.
        squares: along a side, each cut in two triangles.
        regular: whether nodes stay where they are; else the mesh is distorted.
    """
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (squares, squares))
    if not regular:
        mesh = move_nodes(mesh, smooth_distortion)
    K, M, held, start = PAIRS[matrices](mesh)
    stiffness, mass = dense(held.matrix(K)), dense(held.matrix(M))
    values = scipy.linalg.eigvals(stiffness, mass)
    largest = np.abs(values).max()
    step = COURANT * 2 / np.sqrt(largest)
    scalars = {
        "imaginary": float(np.abs(values.imag).max() / largest),
        "growth_per_step": float(_growth(step**2 * values)),
        "smallest_real": float(values.real.min()),
        "lumped_smallest": float(np.diag(mass).min()),
    }
    curves = {"real": values.real, "imaginary": values.imag}
    if "lumped" in matrices:
        period = 2 * np.pi / np.sqrt(np.abs(values).min())
        time, amplitude = _free_vibration(stiffness, np.diag(mass), start, step, PERIODS * period)
        scalars |= {"amplification": amplitude.max(), "steps": float(len(time) - 1)}
        curves |= {"time": time / period, "amplitude": amplitude}
    return Result(scalars, dimensionless(scalars), curves, dofs=K.getSize()[0])


def _growth(values: npt.NDArray[np.complex128]) -> float:
    """Largest |rho| less one, for eigenvalues times dt^2."""
    half = 1 - values / 2
    root = np.sqrt(half**2 - 1 + 0j)
    return max(np.abs(half + root).max(), np.abs(half - root).max()) - 1


def _free_vibration(
    K: Array, mass: Array, start: Array, step: float, end: float
) -> tuple[Array, Array]:
    """Central differences from rest: times, and the largest displacement over that at the start.

    It stops once that has grown beyond all bounds.
    """
    before, now = start, start - step**2 / 2 * (K @ start) / mass
    time, amplitude = [0.0, step], [1.0, np.abs(now).max() / np.abs(start).max()]
    while time[-1] < end and amplitude[-1] < 1e6:
        before, now = now, 2 * now - before - step**2 * (K @ now) / mass
        time.append(time[-1] + step)
        amplitude.append(np.abs(now).max() / np.abs(start).max())
    return np.array(time), np.array(amplitude)


def _matrices(
    mesh: Mesh, stiffness: str, mass: str
) -> tuple[PETSc.Mat, PETSc.Mat, Reduction, Array]:
    """K, M, the clamp, and the displacements under the weight without the clamped ones."""
    pw = Body(Spaces.petrov_galerkin(mesh), MATERIAL, StressState.PLANE_STRESS)
    galerkin = Body(Spaces.galerkin(mesh), MATERIAL, StressState.PLANE_STRESS)
    K_galerkin = assemble_matrix(galerkin.stiffness())
    K_pw = assemble_matrix(pw.stiffness())
    space = pw.spaces.trial
    sibling = Sibling.from_space(galerkin.spaces.trial)
    K = {
        "unsymmetric": K_pw,
        "symmetric part": symmetric_part(K_pw),
        "standard": K_galerkin,
        "sibling": sibling.matrix(K_galerkin),
    }[stiffness]
    M = assemble_matrix(pw.mass())
    if mass == "lumped":
        M = lumped_mass(M, space)
    held = Reduction.dirichlet(space, [prescribe(space, i, _clamped) for i in (0, 1)])
    weight = assemble_vector(galerkin.body_load((0.0, -1.0)))
    sag = solve(K_galerkin, weight, held)
    if stiffness == "sibling":  # its own lumped mass is the new element's on triangles
        sag = sibling.coefficients(sag)
    return K, M, held, dense(held.right).T @ sag.array_r


def _clamped(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


PAIRS = {
    "pw-lumped": partial(_matrices, stiffness="unsymmetric", mass="lumped"),
    "pw-consistent": partial(_matrices, stiffness="unsymmetric", mass="consistent"),
    "pwsym-lumped": partial(_matrices, stiffness="symmetric part", mass="lumped"),
    "galerkin-lumped": partial(_matrices, stiffness="standard", mass="lumped"),
    "sibling-lumped": partial(_matrices, stiffness="sibling", mass="lumped"),
}
# Whose stiffness it is; the mass is that of the new element always
ELEMENTS = {
    "unsymmetric": "pw-T6",
    "symmetric part": "pwsym-T6",
    "standard": "galerkin-T6",
    "sibling": "sibling-T6",
}
SQUARES = 8


def _case(name: str, matrices: str, **parameters: object) -> Case:
    stated = PAIRS[matrices].keywords
    implied = {"element": ELEMENTS[stated["stiffness"]], **stated}
    return Case("V9", name, pair, {"matrices": matrices, **parameters}, implied)


CASES = [_case(name, name, squares=SQUARES) for name in PAIRS]
CASES += [
    _case(f"{name}-{n}", name, squares=n, regular=True)
    for name in ("pw-lumped", "pw-consistent")
    for n in (2, 4)
]
