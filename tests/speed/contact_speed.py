"""Compare contact of the block of section 7.2 with one factorisation of its stiffness matrix.

    ./run python3 -m tests.speed.contact_speed [--divisions 160 320] [--runs 5]

The command prints a table of the medians and ranges of wall times over the runs:

- "contact": solution for pressure and pull applied in a single increment;
- "history": solution for the pressure, followed by the pull;
- "factorisation": analysis, numerical factorisation and accuracy check of one LU of the same
  stiffness matrix.

Each run measures all of these in turn, and the drift of a shared machine cancels in the ratios.
"""

import argparse
import resource
import statistics
import time
from collections.abc import Callable
from functools import partial

from petsc4py import PETSc

from pw_elements import Material, Reduction, assemble_matrix, prescribe
from pw_elements.algebra import factorise
from pw_elements.elasticity import StressState
from study.model.discretisation import Discretisation, discretise
from study.paper import s7_2_block


def measure(divisions: int, runs: int) -> dict[str, list[float]]:
    """Return the wall times in seconds of each part on one mesh, one for each run."""
    body = _block(divisions)
    held = _held(body).matrix(body.K)
    parts: dict[str, Callable[[], object]] = {
        "assembly": lambda: assemble_matrix(body.body.stiffness()),
        "factorisation": lambda: factorise(held),
    }
    for name, loads in _loads(body).items():
        arguments = (body, loads, s7_2_block.FRICTION, True)
        parts[name] = partial(s7_2_block.solve_contact_on_foundation, *arguments)
    times: dict[str, list[float]] = {}
    for _ in range(runs):
        for name, part in parts.items():
            begin = time.perf_counter()
            part()
            times.setdefault(name, []).append(time.perf_counter() - begin)
    times["dofs"] = [float(body.K.getSize()[0])]
    return times


def table(results: dict[int, dict[str, list[float]]]) -> str:
    """Return a Markdown table of medians and ranges in seconds, and of ratios of medians."""
    head = ["triangles", "dofs", "assembly", "factorisation", "contact", "history"]
    head += ["contact / (fact. + ass.)", "history / (fact. + ass.)", "peak memory"]
    rows = [head, ["---:"] * len(head)]
    for divisions, times in results.items():
        middle = {name: statistics.median(values) for name, values in times.items()}
        once = middle["factorisation"] + middle["assembly"]
        row = [str(divisions * divisions), f"{middle['dofs']:.0f}"]
        row += [_seconds(times[name]) for name in head[2:6]]
        row += [f"{middle[name] / once:.2f}" for name in ("contact", "history")]
        rows.append([*row, f"{times['memory'][0]:.0f} MB"])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def main() -> None:
    """Print the table of wall times for the chosen meshes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--divisions", type=int, nargs="+", default=[40, 80, 160])
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    results = {}
    for divisions in sorted(options.divisions):
        results[divisions] = measure(divisions, options.runs)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # MB so far
        results[divisions]["memory"] = [peak]
    print(table(results), end="")


def _block(divisions: int) -> Discretisation:
    material = Material(s7_2_block.YOUNGS_MODULUS, s7_2_block.POISSONS_RATIO)
    build = partial(s7_2_block.mesh_block, (divisions, divisions // 2))
    return discretise("pw-T6", build, material, StressState.PLANE_STRESS)


def _loads(body: Discretisation) -> dict[str, list[PETSc.Vec]]:
    both = s7_2_block.assemble_loads_of_increments(body, s7_2_block.PULL)
    return {"contact": [both[-1]], "history": [both[0], both[-1]]}


def _held(body: Discretisation) -> Reduction:
    """Return the reduction of a block fixed to its foundation, whose stiffness is regular."""
    return body.supports([prescribe(body.space, i, s7_2_block.on_lower_side) for i in (0, 1)])


def _seconds(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} s ({min(values):.2f}-{max(values):.2f})"


if __name__ == "__main__":
    main()
