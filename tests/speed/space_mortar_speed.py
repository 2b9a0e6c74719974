"""Measure the mortar of two deformed sides in space: search, integrals, tangent, verification.

    ./run python3 -m tests.speed.space_mortar_speed [--divisions 11 14] [--runs 5]

The command prints a table of medians and ranges of CPU times. The sides have 8 n^2 sub-triangles,
with the numbers n of `--divisions`; by default 968 of the slave and 1 568 of the master.

- "search": pairs of triangles that are near and face each other;
- "integrals": integrals over the overlaps and their derivatives, including the search;
- "linearisation": mortar at given positions, including the integrals;
- "tangent": derivatives of the master's forces, gaps, slips and normals by all positions;
- "iteration": sum of linearisation and tangent;
- "verification": the independent integrals, once for each end of an increment.
"""

import argparse
import statistics
import time

import numpy as np

from pw_elements.contact.interface import SpaceSlidingMortar
from tests.contact.sides_in_space import make_facets_of_height_field, slave_mask


def make_mortar(divisions: list[int]) -> SpaceSlidingMortar:
    """Return the mortar of a shallow dome on a wavy surface, with non-matching meshes."""
    slave = make_facets_of_height_field(
        divisions[0], lambda x, y: 0.1 * (x**2 + y**2), 0, -1.0, half_width=0.6, jitter=2e-3
    )
    master = make_facets_of_height_field(
        divisions[1],
        lambda x, y: 0.05 * np.sin(2 * x) * np.cos(y),
        10**6,
        1.0,
        half_width=0.8,
        jitter=2e-3,
        seed=1,
    )
    return SpaceSlidingMortar(slave, master)


def measure(divisions: list[int], runs: int) -> dict[str, list[float]]:
    """Return the CPU times in seconds of each part, one for each run."""
    mortar = make_mortar(divisions)
    x = mortar.x + slave_mask(mortar) * [0.05, 0.02, 0.0]
    reference, force = mortar.make_slip_reference(mortar.x), np.ones((mortar.n_slave_nodes, 3))
    times: dict[str, list[float]] = {}

    def compute_tangent() -> None:
        projected.differentiate_master_forces(force)
        projected.measure_slip_and_motion_derivatives(reference, x)

    for _ in range(runs):
        projected = mortar.linearise(x)
        for name, part in {
            "search": lambda: mortar._find_near_facing_facet_pairs(x),
            "integrals": lambda: mortar._integrate_over_facing_parts(x),
            "linearisation": lambda: mortar.linearise(x),
            "tangent": compute_tangent,
            "verification": lambda: mortar.evaluate_mortar_matrices_independently(x),
        }.items():
            begin = time.process_time()
            part()
            times.setdefault(name, []).append(time.process_time() - begin)
        iteration = times["linearisation"][-1] + times["tangent"][-1]
        times.setdefault("iteration", []).append(iteration)
    return times


def main() -> None:
    """Print the table of CPU times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--divisions", type=int, nargs=2, default=[11, 14])
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    times = measure(options.divisions, options.runs)
    sizes = " on ".join(str(8 * n * n) for n in options.divisions)
    print(f"| {sizes} triangles | median | range |\n| --- | ---: | ---: |")
    for name, values in times.items():
        print(
            f"| {name} | {statistics.median(values):.3f} s | {min(values):.3f}-{max(values):.3f} |"
        )


if __name__ == "__main__":
    main()
