"""Energy balance of a rubber block under a rough cylinder that presses, slides, returns and lifts.

    ./run python3 -m tests.contact.energy_balance [--increments 4 8 16 32 64]

prints the energy that is not accounted for, for the standard and the new element and for several
numbers of increments per leg of the path. This energy is the work of the tool minus the stored
energy and the friction work, divided by the sum of the absolute work of all increments. Friction
work is the shear force times the slip, summed over the nodes. Work is computed by the trapezoidal
rule and, for comparison, with the forces at the ends of the increments.
"""

import argparse
from itertools import pairwise
from typing import NamedTuple

from mpi4py import MPI

import numpy as np
import ufl

from pw_elements import Spaces, assemble_scalar, prescribe
from pw_elements.contact import ContactPair, ContactProblem, Motion, Sphere
from pw_elements.meshes import triangles
from tests.contact.cases import (
    make_finite_strain_unknown_and_residual,
    neo_hookean_piola_stress,
    on_plane,
)

LAME_RATIO, FRICTION = 1.5, 0.3  # Lame's lambda / shear modulus; friction coefficient
# Translations of the cylinder at the ends of the legs, divided by its radius
CYLINDER_TRANSLATIONS_IN_RADII = (
    (0.0, 0.0),
    (0.0, -0.25),
    (0.25, -0.25),
    (-0.1, -0.25),
    (-0.1, 0.05),
)
SPACE_MAKERS_BY_ELEMENT_NAME = {"galerkin": Spaces.galerkin, "pw": Spaces.petrov_galerkin}


class EnergyBalance(NamedTuple):
    """Energies at the end of the path, divided by the sum of the absolute work of increments."""

    remainder: float
    end_force_remainder: float  # remainder if work is computed with the forces at increments' ends
    stored_energy: float
    friction_work: float


def measure_energy_balance(
    element: str, increments_per_leg: int, cells_per_radius: int = 4
) -> EnergyBalance:
    """Move the cylinder along its path, and return the energies at the end.

    `element` is a key of `SPACE_MAKERS_BY_ELEMENT_NAME`, and `increments_per_leg` the number of
    equal increments per leg of the path. The mesh consists of squares of size
    1 / `cells_per_radius`, each split into two triangles.
    """
    divisions = (int(2.5 * cells_per_radius), cells_per_radius)
    mesh = triangles(MPI.COMM_SELF, (-1.25, -1.0), (1.25, 0.0), divisions, "right_left")
    spaces = SPACE_MAKERS_BY_ELEMENT_NAME[element](mesh)
    u, residual = make_finite_strain_unknown_and_residual(
        spaces, lambda F: neo_hookean_piola_stress(F, 1.0, LAME_RATIO)
    )
    F = ufl.Identity(2) + ufl.grad(u)
    log = ufl.ln(ufl.det(F))
    density = (ufl.inner(F, F) - 2) / 2 - log + LAME_RATIO / 2 * log**2
    energy = density * ufl.dx(metadata={"quadrature_degree": 4})
    conditions = [prescribe(spaces.trial, k, on_plane(1, -1.0)) for k in (0, 1)]
    pair = ContactPair(on_plane(1, 0.0), Sphere((0.0, 1.0), 1.0), FRICTION)
    problem = ContactProblem.of_residual(residual, u, conditions, pair)
    state, total_work = problem.undeformed, 0.0
    # work of the tool and of friction, keyed by the weight of the force at an increment's end
    sums = {0.5: np.zeros(2), 1.0: np.zeros(2)}
    for start, end in pairwise(CYLINDER_TRANSLATIONS_IN_RADII):
        for k in range(increments_per_leg):
            fraction = (k + 1) / increments_per_leg
            translation = (1 - fraction) * np.array(start) + fraction * np.array(end)
            state, previous = problem.step(state, motions=Motion(translation)), state
            substates = [inner_state for _, inner_state in state.substates]
            slips = [inner_state.pairs[0].slip for inner_state in substates]
            slips.append(state.pairs[0].slip - sum(slips))
            for substate, slip in zip((*substates, state), slips, strict=True):
                (old_pair,), (new_pair,) = previous.pairs, substate.pairs
                travel = new_pair.translation - old_pair.translation
                total_work += abs(float((old_pair.force + new_pair.force) @ travel)) / 2
                for end_weight, total in sums.items():
                    force = (1 - end_weight) * old_pair.force + end_weight * new_pair.force
                    shear = (
                        1 - end_weight
                    ) * old_pair.force_tangential + end_weight * new_pair.force_tangential
                    total += force @ travel, -np.sum(shear * slip)
                previous = substate
    u.x.array[: state.unknowns.getLocalSize()] = state.unknowns.array_r
    stored = assemble_scalar(energy)
    remainders = [
        float(work - stored - friction_work) / total_work for work, friction_work in sums.values()
    ]
    return EnergyBalance(*remainders, stored / total_work, float(sums[0.5][1]) / total_work)


def print_energy_balances() -> None:
    """Print the energy balances of all elements, meshes and numbers of increments."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--increments", type=int, nargs="+", default=[4, 8, 16, 32])
    parser.add_argument("--per-radius", type=int, nargs="+", default=[4])
    options = parser.parse_args()
    for element in SPACE_MAKERS_BY_ELEMENT_NAME:
        for per_radius in options.per_radius:
            for n in options.increments:
                balance = measure_energy_balance(element, n, per_radius)
                print(element, f"h = R/{per_radius}, {n} increments a leg:", balance, flush=True)


if __name__ == "__main__":
    print_energy_balances()
