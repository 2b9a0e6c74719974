"""Verification of explicit dynamics: which stiffness suits a positive lumped mass."""

from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import scipy.linalg
from dolfinx.mesh import Mesh
from matplotlib.figure import Figure

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
from study.judge.checks import check
from study.judge.measures.general import scalar
from study.meshes.distortion import distort_unit_domain_smoothly
from study.model.matrices import to_dense_array
from study.model.units import assign_unit_one_to_scalars
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case
from study.run.pages import PageFigure
from study.run.store import Result, Results

SECTION = "V9"
TITLE = "Explicit dynamics with lumped mass"
FACTS = {
    "geometry": "a unit square",
    "mesh": "8 × 8 distorted squares, 4 × 4 and 2 × 2, cut into triangles",
    "material": "linear elastic, plane stress; E = 1, ν = 0.3, density 1",
    "supports": "clamped at the left side",
    "load": "released from its deflection under weight; ten periods",
    "reference": "all eigenvalues; the amplification of central differences",
    "uncertainty": "found on some meshes of one body, not derived",
}
SHORT_FACTS = {
    "reference": "all eigenvalues; amplification of central differences",
    "uncertainty": "found on some meshes, not derived",
}

# Problem

THEORY = r"""
The row sums of the new element's mass matrix are positive (section 3), whereas the standard triangle has zeros. They
provide a diagonal mass for explicit dynamics. With which stiffness can it be combined?
"""

# E, the density and the square's side are one: all numbers are dimensionless
MATERIAL = Material(1.0, 0.3)

# Method

METHOD = r"""
A unit square in plane stress, with 8 × 8 distorted squares cut into triangles, is clamped at its left side and released
from its displacements under its own weight. All eigenvalues of each pair $(\boldsymbol{K}, \boldsymbol{M})$ are computed,
and ten periods of free vibration are integrated by central differences at half the largest stable step. In each step,
central differences multiply the component belonging to an eigenvalue $w$ by factors $\rho$ with
$\rho^2 - (2 - \Delta t^2\, w)\, \rho + 1 = 0$, whose product is one: unless $w$ is real and $\Delta t^2\, w \le 4$, one of
them exceeds one in magnitude and that component grows, whatever the step.
"""

TIME_STEP_FRACTION = 0.5
"""Ratio of the time step to the largest one that is stable if all eigenvalues are real."""
N_PERIODS = 10
"""Duration of the vibration in periods of the slowest mode."""
MAX_RELATIVE_AMPLITUDE = 1e6
"""Largest displacement, over the initial one, at which integration of a growing vibration stops."""


def pair(matrices: str, squares: int, regular: bool = False) -> Result:
    """Compute all eigenvalues of stiffness and mass on a clamped square, and its free vibration.

    Args:
        matrices: Name of the matrices K and M, a key of `MATRIX_PAIRS`.
        squares: Number of squares along a side, each cut into two triangles.
        regular: Whether the mesh is regular; otherwise it is distorted.
    """
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (squares, squares))
    if not regular:
        mesh = move_nodes(mesh, distort_unit_domain_smoothly)
    K, M, clamp, initial_displacement = MATRIX_PAIRS[matrices](mesh)
    stiffness, mass = to_dense_array(clamp.matrix(K)), to_dense_array(clamp.matrix(M))
    eigenvalues = scipy.linalg.eigvals(stiffness, mass)
    largest = np.abs(eigenvalues).max()
    time_step = TIME_STEP_FRACTION * 2 / np.sqrt(largest)
    scalars = {
        "imaginary": float(np.abs(eigenvalues.imag).max() / largest),
        "growth_per_step": float(
            _largest_amplification_per_step_less_one(time_step**2 * eigenvalues)
        ),
        "smallest_real": float(eigenvalues.real.min()),
        "lumped_smallest": float(np.diag(mass).min()),
    }
    curves = {"real": eigenvalues.real, "imaginary": eigenvalues.imag}
    if "lumped" in matrices:
        period = 2 * np.pi / np.sqrt(np.abs(eigenvalues).min())
        end_time = N_PERIODS * period
        time, amplitude = _integrate_free_vibration(
            stiffness, np.diag(mass), initial_displacement, time_step, end_time
        )
        scalars |= {"amplification": amplitude.max(), "steps": float(len(time) - 1)}
        curves |= {"time": time / period, "amplitude": amplitude}
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=K.getSize()[0])


def _largest_amplification_per_step_less_one(
    scaled_eigenvalues: npt.NDArray[np.complex128],
) -> float:
    """Return the largest |rho| - 1 with the amplification rho by a central-difference step.

    Args:
        scaled_eigenvalues: Eigenvalues (n,) of M^-1 K times the squared time step.
    """
    half_sum = 1 - scaled_eigenvalues / 2
    root = np.sqrt(half_sum**2 - 1 + 0j)
    return max(np.abs(half_sum + root).max(), np.abs(half_sum - root).max()) - 1


def _integrate_free_vibration(
    K: npt.NDArray[np.float64],
    mass: npt.NDArray[np.float64],
    initial_displacement: npt.NDArray[np.float64],
    time_step: float,
    end_time: float,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Integrate a free vibration, which starts at rest, by central differences.

    Integration stops at the end time or when displacements exceed `MAX_RELATIVE_AMPLITUDE`.

    Args:
        K: Stiffness (n, n).
        mass: Lumped masses (n,).
        initial_displacement: Initial displacements (n,).
        time_step: Time step.
        end_time: Time at which the integration ends.

    Returns:
        Times (s,), and at each time the largest displacement over the largest initial one (s,).
    """
    previous, current = (
        initial_displacement,
        initial_displacement - time_step**2 / 2 * (K @ initial_displacement) / mass,
    )
    time, amplitude = (
        [0.0, time_step],
        [1.0, np.abs(current).max() / np.abs(initial_displacement).max()],
    )
    while time[-1] < end_time and amplitude[-1] < MAX_RELATIVE_AMPLITUDE:
        previous, current = current, 2 * current - previous - time_step**2 * (K @ current) / mass
        time.append(time[-1] + time_step)
        amplitude.append(np.abs(current).max() / np.abs(initial_displacement).max())
    return np.array(time), np.array(amplitude)


def _assemble_matrices_and_static_deflection(
    mesh: Mesh, stiffness: str, mass: str
) -> tuple[PETSc.Mat, PETSc.Mat, Reduction, npt.NDArray[np.float64]]:
    """Assemble stiffness, mass and clamp of a square, and its deflection under its weight.

    Args:
        mesh: Mesh of the square.
        stiffness: "unsymmetric", "symmetric part", "standard" or "sibling".
        mass: "lumped" or "consistent".

    Returns:
        K, M, the clamp, and the static deflection in the unknowns that are not clamped.
    """
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
    clamp = Reduction.dirichlet(space, [prescribe(space, i, _is_clamped) for i in (0, 1)])
    weight = assemble_vector(galerkin.body_load((0.0, -1.0)))
    deflection = solve(K_galerkin, weight, clamp)
    if stiffness == "sibling":  # on triangles the sibling's lumped mass equals the new element's
        deflection = sibling.coefficients(deflection)
    return K, M, clamp, to_dense_array(clamp.right).T @ deflection.array_r


def _is_clamped(x: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


# Cases

MATRIX_PAIRS = {
    "pw-lumped": partial(
        _assemble_matrices_and_static_deflection, stiffness="unsymmetric", mass="lumped"
    ),
    "pw-consistent": partial(
        _assemble_matrices_and_static_deflection, stiffness="unsymmetric", mass="consistent"
    ),
    "pwsym-lumped": partial(
        _assemble_matrices_and_static_deflection, stiffness="symmetric part", mass="lumped"
    ),
    "galerkin-lumped": partial(
        _assemble_matrices_and_static_deflection, stiffness="standard", mass="lumped"
    ),
    "sibling-lumped": partial(
        _assemble_matrices_and_static_deflection, stiffness="sibling", mass="lumped"
    ),
}
ELEMENT_BY_STIFFNESS = {
    "unsymmetric": "pw-T6",
    "symmetric part": "pwsym-T6",
    "standard": "galerkin-T6",
    "sibling": "sibling-T6",
}
"""Element that provides the stiffness; the mass is always that of the new element."""
N_SQUARES = 8


def _make_matrix_pair_case(name: str, matrices: str, **parameters: object) -> Case:
    kinds = MATRIX_PAIRS[matrices].keywords
    implied = {"element": ELEMENT_BY_STIFFNESS[kinds["stiffness"]], **kinds}
    return Case("V9", name, pair, {"matrices": matrices, **parameters}, implied)


CASES = [_make_matrix_pair_case(name, name, squares=N_SQUARES) for name in MATRIX_PAIRS]
CASES += [
    _make_matrix_pair_case(f"{name}-{n}", name, squares=n, regular=True)
    for name in ("pw-lumped", "pw-consistent")
    for n in (2, 4)
]

# Results

DETAILS = r"""
{% call table("v9-spectra-and-growth", "Spectra and growth.") %}
| Stiffness, mass, mesh | Largest \|Im ω²\| over largest \|ω²\| | Growth per step, % | Largest displacement over the initial one |
|---|---:|---:|---:|
{% for case, words in (("pw-lumped", "new, lumped, 8 × 8 distorted"), ("pwsym-lumped", "its symmetric part, lumped, 8 × 8 distorted"), ("galerkin-lumped", "standard, lumped (new), 8 × 8 distorted"), ("sibling-lumped", "symmetric sibling, lumped, 8 × 8 distorted"), ("pw-lumped-4", "new, lumped, 4 × 4"), ("pw-lumped-2", "new, lumped, 2 × 2")) %}
| {{ words }} | {{ num(s("V9/" ~ case, "imaginary"), 2) }} | {{ num(100 * s("V9/" ~ case, "growth_per_step"), 2) }} | {{ num(s("V9/" ~ case, "amplification"), 3) }} |
{% endfor %}
{% for case, words in (("pw-consistent", "new, consistent, 8 × 8 distorted"), ("pw-consistent-4", "new, consistent, 4 × 4"), ("pw-consistent-2", "new, consistent, 2 × 2")) %}
| {{ words }} | {{ num(s("V9/" ~ case, "imaginary"), 2) }} | {{ num(100 * s("V9/" ~ case, "growth_per_step"), 2) }} | – |
{% endfor %}
{% endcall %}
"""

PLOT_SERIES = {
    "pw-lumped": ("new stiffness, unsymmetric", "pw-T6"),
    "pwsym-lumped": ("its symmetric part", "pwsym-T6"),
    "galerkin-lumped": ("standard stiffness", "galerkin-T6"),
}
"""Legend label and element whose colour is used, by case."""
STEPS_PER_POINT = 20
"""Number of time steps whose largest displacement is drawn as one point."""


def draw_spectra_and_free_vibration(results: Results) -> Figure:
    """Draw spectra and free vibrations by central differences with a lumped mass.

    The panels show eigenvalues in the complex plane and displacements over time.
    """
    fig, (spectrum, motion) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.6))
    for case, (label, element) in PLOT_SERIES.items():
        curves = results.curves(f"V9/{case}")
        color = ELEMENT_LOOK[element]["color"]
        spectrum.plot(curves["real"], curves["imaginary"], ".", color=color, ms=3, label=label)
        # envelope: a plain subsample would miss maxima
        starts = np.arange(0, len(curves["time"]), STEPS_PER_POINT)
        envelope = np.maximum.reduceat(curves["amplitude"], starts)
        dashes = "--" if case == "galerkin-lumped" else "-"
        motion.semilogy(curves["time"][starts], envelope, dashes, color=color, lw=1.2, label=label)
    spectrum.set(title="(a) spectrum", xlabel=r"Re $\omega^2$", ylabel=r"Im $\omega^2$")
    motion.set(title="(b) free vibration", xlabel="time / slowest period")
    motion.set_ylabel("displacement / initial one")
    motion.legend(fontsize=7)
    return fig


def caption_spectra_and_free_vibration(results: Results) -> str:
    """Return the caption of the spectra and the vibration, including the growth per step."""
    growth = results.scalar("V9/pw-lumped", "growth_per_step")
    return (
        "Clamped square with the new element's lumped mass. (a) All eigenvalues: in the upper "
        "spectrum those of the unsymmetric stiffness leave the real axis. (b) Largest displacement "
        "in a free vibration by central differences with half the stable time step; the "
        f"fastest-growing component gains {100 * growth:.2g} % per step."
    )


def alt_text_of_spectra_and_free_vibration(results: Results) -> str:
    """Return the text alternative of the figure, including the largest displacement."""
    size = results.scalar("V9/pw-lumped", "amplification")
    return (
        "Eigenvalues of the symmetric pairs on the real axis, those of the unsymmetric one around "
        f"it. Displacements of the former stay of size one, those of the latter grow to {size:.0e}."
    )


FIGURES = [
    PageFigure(
        "v9_explicit",
        draw_spectra_and_free_vibration,
        needs=[f"V9/{case}" for case in PLOT_SERIES],
        caption=caption_spectra_and_free_vibration,
        alt=alt_text_of_spectra_and_free_vibration,
    ),
]

VERIFICATION = r"""
| free vibration, lumped mass | no growth | growth per step | {{ pct(s("V9/pw-lumped", "growth_per_step")) }} | {{ num(s("V9/galerkin-lumped", "growth_per_step"), 1) }} |
"""

# Findings

CHECKS = [
    check(
        "V9-positive",
        "The smallest lumped mass of the new triangle on the clamped square is positive.",
        lambda results: scalar(results, key="V9/pw-lumped", name="lumped_smallest"),
        ">",
        0.0,
        tolerance_why="none: a sign",
        why="Row sums are integrals of positive weight functions.",
    ),
    check(
        "V9-grows",
        "Free vibration by central differences, at half the largest stable step, grows a "
        "million times within ten periods.",
        lambda results: scalar(results, key="V9/pw-lumped", name="amplification"),
        ">",
        1000000.0,
        tolerance_why="none: a size, at which the computation stops",
        why="The parts that grow start from round-off and the initial state's small share of "
        "short waves.",
    ),
]

FINDINGS = r"""
**The unsymmetric stiffness is unstable without damping.** With the new element's stiffness part of the upper spectrum is
complex: with a lumped mass on every mesh, with the consistent mass on all but the coarsest ({{ ref("v9_explicit") }}). In
central differences some components of the motion then grow, here by up to
{{ most(100 * measure("largest", section="V9", cases="pw-lumped.*", name="growth_per_step")) }} % per step. The lowest
eigenvalues are real and accurate.

{{ figure("v9_explicit") }}
"""

FURTHER_FINDINGS = r"""
1. **The lumped mass itself is sound:** with the symmetric part of the new stiffness, the standard one, or its symmetric
   sibling $\boldsymbol{T} \boldsymbol{K} \boldsymbol{T}^\mathrm{T}$, all eigenvalues are real and positive and the
   vibration stays bounded. Symmetrising costs two orders of convergence of the eigenvalues (section V8), as lumping does.
"""

# Limits

LIMITS = r"""
Complex eigenvalues are found on some meshes of one body, not derived. Whether damping of the upper spectrum is a remedy is
not studied; section V12 deals with contact in dynamics.
"""
