"""Viscoelastic rubber at large strains below a plate: a block with a known force, and a seal.

The rubber is incompressible and neo-Hookean, with one Maxwell branch in the convolution form of
J. C. Simo (1987, doi:10.1016/0045-7825(87)90107-1). If S is the deviatoric second Piola-Kirchhoff
stress of slow deformations, the branch has the additional stress

    Q(t) = g * integral of exp(-(t - s) / tau) (dS/ds) ds,

which the midpoint rule integrates over a time step. The time at the start of a step is a history
variable, so that each substep of a cut increment has a length of its own.
"""

from itertools import pairwise

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.integrate import quad
from ufl.core.expr import Expr

from pw_elements import history_space, prescribe
from pw_elements.contact import OPEN, ContactPair, ContactProblem, Motion, Plane
from pw_elements.contact.model import ContactState
from pw_elements.meshes import curved_mesh, triangles
from pw_elements.spaces import Marker
from study.model.discretisation import make_element_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.cases import Case
from study.run.store import Result, Results
from study.solutions.rubber import Array

# Stresses are relative to the shear modulus of slow deformations, times to the relaxation time
BRANCH_MODULUS = 1.5
DEGREE = 4
"""Degree of quadrature in each sub-triangle."""
COMPRESSION = 0.3
"""Displacement of the plate over the height of the block or the radius of the seal, which is 1."""
RAMP_TIME, HOLDING_TIME = 1.0, 2.0
HELD_TIMES = (0.0, 0.01, 0.02, 0.1, 0.25, 1.0, 1.3, 4.0)
BLOCK_CELLS, SEAL_CELLS = 3, 8
STEP_COUNTS = (3, 6, 12)


def advance_stresses(F: Expr, branch: Expr, slow: Expr, duration: Expr) -> tuple[Expr, Expr]:
    """Return the stresses Q and S at the end of a time step.

    Args:
        F: Deformation gradient (3, 3) at the end.
        branch: Stress Q (3, 3) at the start.
        slow: Stress S (3, 3) at the start.
        duration: Length of the step over the relaxation time; it may be zero.
    """
    C = F.T * F
    new_slow = ufl.det(F) ** (-2 / 3) * (ufl.Identity(3) - ufl.tr(C) / 3 * ufl.inv(C))
    change = BRANCH_MODULUS * ufl.exp(-duration / 2) * (new_slow - slow)
    return ufl.exp(-duration) * branch + change, new_slow


def relaxing_block(element: str) -> Result:
    """Compress a block suddenly and hold it; compare with the exact relaxation.

    Args:
        element: Name of a hybrid element such as "pw-hybrid-T6".
    """
    times = np.array(HELD_TIMES)
    forces, _ = _compress_block(element, times, np.full(len(times), COMPRESSION))
    exact = _block_force(_slow_stress(COMPRESSION)) * (1 + BRANCH_MODULUS * np.exp(-times))
    curves = {"time": times, "force": forces, "exact": exact}
    return _make_result({"force_error": np.abs(forces / exact - 1).max()}, curves)


def ramped_block(element: str, steps: int) -> Result:
    """Compress a block at a constant speed; compare with the convolution integral.

    Args:
        element: Name of a hybrid element such as "pw-hybrid-T6".
        steps: Number of time steps.
    """
    fractions = np.arange(1, steps + 1) / steps
    forces, _ = _compress_block(element, RAMP_TIME * fractions, COMPRESSION * fractions)
    stress = _slow_stress(COMPRESSION)

    def integrand(s: float, axis: int) -> float:
        return float(np.exp(s - RAMP_TIME) * _slow_stress(COMPRESSION * s / RAMP_TIME)[axis])

    # by parts
    memory = [quad(integrand, 0, RAMP_TIME, (axis,), epsabs=1e-13)[0] for axis in range(2)]
    exact = _block_force(stress + BRANCH_MODULUS * (stress - memory))
    return _make_result({"force_error": abs(forces[-1] / exact - 1)}, {})


def seal(element: str, steps: int) -> Result:
    """Compress a seal of circular section at a constant speed, and hold it.

    Args:
        element: Name of a hybrid element such as "pw-hybrid-T6".
        steps: Number of time steps of the ramp, and of the holding time.
    """
    square = triangles(MPI.COMM_SELF, (0, 0), (1, 1), (SEAL_CELLS, SEAL_CELLS), "crossed")
    quarter = curved_mesh(square, lambda x: x * np.sqrt(1 - x[:, [1, 0, 2]] ** 2 / 2))
    fractions = np.arange(1, steps + 1) / steps
    times = np.concatenate([RAMP_TIME * fractions, RAMP_TIME + HOLDING_TIME * fractions])
    forces, states = _compress(
        element,
        quarter,
        lambda x: np.isclose(np.hypot(x[0], x[1]), 1) & (x[1] > 0.35),
        times,
        COMPRESSION * np.minimum(times / RAMP_TIME, 1),
    )
    (plate,) = states[-1].pairs
    scalars = {
        "ramp_force": forces[steps - 1],
        "last_force": forces[-1],
        "half_width": (plate.position + plate.displacement)[plate.status != OPEN, 0].max(),
        "cut": sum(bool(state.substates) for state in states),
    }
    return _make_result(scalars, {"time": times, "force": forces})


def convergence_order(results: Results, name: str) -> float:
    """Return the order in the time step by which a scalar of the seal converges."""
    values = [results.scalar(f"V19/seal-pw-hybrid-T6-{n}", name) for n in STEP_COUNTS]
    coarse, fine = np.diff(values)
    return float(np.log2(coarse / fine))


def _compress_block(
    element: str, times: Array, compressions: Array
) -> tuple[Array, list[ContactState]]:
    mesh = triangles(MPI.COMM_SELF, (0, 0), (1, 1), (BLOCK_CELLS, BLOCK_CELLS))
    return _compress(element, mesh, lambda x: np.isclose(x[1], 1), times, compressions)


def _compress(
    element: str, mesh: Mesh, is_contact_side: Marker, times: Array, compressions: Array
) -> tuple[Array, list[ContactState]]:
    """Compress rubber in plane strain below a plate.

    Returns:
        Forces (steps,) of the plate; states.
    """
    spaces = make_element_spaces(element, mesh)
    tensors, dx = history_space(spaces, (3, 3), DEGREE)
    numbers, _ = history_space(spaces, (), DEGREE)
    branch, slow = fem.Function(tensors), fem.Function(tensors)
    start_time, time = fem.Function(numbers), fem.Constant(mesh, 0.0)
    solution = fem.Function(spaces.trial)
    (u, p), (v, q) = ufl.split(solution), ufl.split(ufl.TestFunction(spaces.test))
    F = ufl.Identity(3) + _plane_strain_gradient(u)
    J = ufl.det(F)
    new_branch, new_slow = advance_stresses(F, branch, slow, time - start_time)
    stress = F * (new_slow + new_branch) - p * J * ufl.inv(F).T
    problem = ContactProblem.of_residual(
        (ufl.inner(stress, _plane_strain_gradient(v)) - q * (J - 1)) * dx,
        solution,
        [
            prescribe(spaces.trial, 0, lambda x: np.isclose(x[0], 0)),
            prescribe(spaces.trial, 1, lambda x: np.isclose(x[1], 0)),
        ],
        ContactPair(is_contact_side, Plane((0.0, 1.0), (0.0, -1.0))),
        history={branch: new_branch, slow: new_slow, start_time: time},
    )
    states = [problem.undeformed]
    for (start, end), compression in zip(pairwise([0.0, *times]), compressions, strict=True):

        def set_time(fraction: float, start: float = start, end: float = end) -> None:
            time.value = start + fraction * (end - start)

        states.append(problem.step(states[-1], set_time, Motion((0.0, -compression))))
    return np.array([-state.pairs[0].force[1] for state in states[1:]]), states[1:]


def _plane_strain_gradient(u: Expr) -> Expr:
    g = ufl.grad(u)
    return ufl.as_tensor([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, 0]])


def _slow_stress(compression: float) -> Array:
    """Return the stresses S (2,) of the block, across and along its compression."""
    stretch = np.array([1 / (1 - compression), 1 - compression])
    return np.asarray(1 - (1 + np.sum(stretch**2)) / (3 * stretch**2))


def _block_force(stress: Array) -> float:
    """Return the force on the compressed block from its stresses (2,)."""
    height = 1 - COMPRESSION
    return float(stress[0] / height**3 - stress[1] * height)


def _make_result(scalars: dict[str, float], curves: dict[str, Array]) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, assign_unit_one_to_scalars(numbers), curves)


VISCOELASTIC_CASES = [
    Case("V19", "relaxing-pw-hybrid-T6", relaxing_block, {"element": "pw-hybrid-T6"}),
    *(
        Case("V19", f"{name}-pw-hybrid-T6-{n}", run, {"element": "pw-hybrid-T6", "steps": n})
        for name, run in (("ramp", ramped_block), ("seal", seal))
        for n in STEP_COUNTS
    ),
]
