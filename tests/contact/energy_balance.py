"""Energy of a rubber block below a rough cylinder that is pressed, slid, taken back and unloaded.

    ./run python3 -m tests.contact.energy_balance [--increments 4 8 16 32 64]

prints, for the standard and the new element and several numbers of increments a leg, what the
tool's work leaves after the stored energy and what friction has spent, over the sum of the sizes of
work. Friction spends the shear times the slip at every node. Sums are trapezoidal, or take forces
at the ends of increments.
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
from tests.contact.cases import finite_strain_residual, neo_hookean_stress, on_plane

LAME_RATIO, FRICTION = 1.5, 0.3  # over the shear modulus
# places of the cylinder at the ends of the legs, over its radius
CYLINDER_PATH = ((0.0, 0.0), (0.0, -0.25), (0.25, -0.25), (-0.1, -0.25), (-0.1, 0.05))
ELEMENTS = {"galerkin": Spaces.galerkin, "pw": Spaces.petrov_galerkin}


class EnergyBalance(NamedTuple):
    """Energies at the end, over the size of all work."""

    remainder: float
    end_force_remainder: float  # the remainder by sums with forces at the ends of increments
    stored_energy: float
    friction_work: float


def measure_energy_balance(
    element: str, increments: int, cells_per_radius: int = 4
) -> EnergyBalance:
    """Follow the legs in equal increments on squares of the size 1 / per_radius, halved."""
    divisions = (int(2.5 * cells_per_radius), cells_per_radius)
    mesh = triangles(MPI.COMM_SELF, (-1.25, -1.0), (1.25, 0.0), divisions, "right_left")
    spaces = ELEMENTS[element](mesh)
    u, residual = finite_strain_residual(spaces, lambda F: neo_hookean_stress(F, 1.0, LAME_RATIO))
    F = ufl.Identity(2) + ufl.grad(u)
    log = ufl.ln(ufl.det(F))
    density = (ufl.inner(F, F) - 2) / 2 - log + LAME_RATIO / 2 * log**2
    energy = density * ufl.dx(metadata={"quadrature_degree": 4})
    held = [prescribe(spaces.trial, k, on_plane(1, -1.0)) for k in (0, 1)]
    pair = ContactPair(on_plane(1, 0.0), Sphere((0.0, 1.0), 1.0), FRICTION)
    problem = ContactProblem.of_residual(residual, u, held, pair)
    state, size = problem.undeformed, 0.0
    # work, and what friction spends, by the share of the end's forces in sums
    sums = {0.5: np.zeros(2), 1.0: np.zeros(2)}
    for start, end in pairwise(CYLINDER_PATH):
        for k in range(increments):
            share = (k + 1) / increments
            place = (1 - share) * np.array(start) + share * np.array(end)
            state, before = problem.step(state, motions=Motion(place)), state
            parts = [part for _, part in state.substates]
            slips = [part.pairs[0].slip for part in parts]
            slips.append(state.pairs[0].slip - sum(slips))
            for after, slip in zip((*parts, state), slips, strict=True):
                (old,), (new,) = before.pairs, after.pairs
                way = new.translation - old.translation
                size += abs(float((old.force + new.force) @ way)) / 2
                for share, total in sums.items():
                    force = (1 - share) * old.force + share * new.force
                    shear = (1 - share) * old.force_tangential + share * new.force_tangential
                    total += force @ way, -np.sum(shear * slip)
                before = after
    u.x.array[: state.unknowns.getLocalSize()] = state.unknowns.array_r
    stored = assemble_scalar(energy)
    remainders = [float(work - stored - spent) / size for work, spent in sums.values()]
    return EnergyBalance(*remainders, stored / size, float(sums[0.5][1]) / size)


def main() -> None:
    """Print the balances."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--increments", type=int, nargs="+", default=[4, 8, 16, 32])
    parser.add_argument("--per-radius", type=int, nargs="+", default=[4])
    options = parser.parse_args()
    for element in ELEMENTS:
        for per_radius in options.per_radius:
            for n in options.increments:
                balance = measure_energy_balance(element, n, per_radius)
                print(element, f"h = R/{per_radius}, {n} increments a leg:", balance, flush=True)


if __name__ == "__main__":
    main()
