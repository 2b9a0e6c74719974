"""What comes of many random contact problems: solved or refused, and how exactly.

python3 -m tests.oracle.outcomes 0 1600 --out before.jsonl
python3 -m tests.oracle.outcomes 0 1600 --compare before.jsonl
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path
from time import process_time

import numpy as np

from pw_elements.contact import ContactFailed, NoEquilibrium
from pw_elements.contact.model import ContactState
from tests.contact.residuals import _contact_nodes, residuals, walked, worst
from tests.oracle.proofs import flaws, linear_increment, sound
from tests.oracle.random_contact import Problem, problem
from tests.oracle.search import search


def outcome(seed: int) -> dict:
    """What came of a seed, as JSON: solved or refused, iterations, norms, residuals."""
    stated = problem(seed)
    result: dict = {"seed": seed, "description": stated.sketch.description, "outcome": "solved"}
    begun = process_time()
    try:
        states = stated.solve()
        result["seconds"] = process_time() - begun
    except ContactFailed as error:
        result["seconds"] = process_time() - begun
        states = list(error.states)
        result |= {"outcome": type(error).__name__, "message": str(error)}
        if isinstance(error, NoEquilibrium):
            proof = flaws(stated, len(states), error)
            result |= {"proof": proof, "proved": sound(proof)}
        if _is_searchable(stated):
            found_by_search = search(linear_increment(stated, states))
            result["search"] = "none" if found_by_search is None else "a state"
    except Exception as error:  # a bug, whatever it is: the others are to be seen, too
        states = []
        result |= {"outcome": f"BUG {type(error).__name__}", "message": str(error)}
    found = residuals(*walked(stated, states))
    return result | {
        "dim": stated.sketch.dim,
        "increments": len(stated.loads),
        "driven by force": stated.sketch.driven_by_force,
        "iterations": [state.iterations for state in states],
        "cut": [len(state.substates) for state in states],
        "norms": [state.displacement.norm() for state in states],
        "forces": [[pair.force.tolist() for pair in state.pairs] for state in states],
        "translations": [[pair.translation.tolist() for pair in state.pairs] for state in states],
        "unique": all(state.unique for state in states),
        "pressed": _pressed(stated, states),
        "largest mu": max(pair.mu for pair in stated.sketch.pairs),
        "residual": worst(found),
        "residuals": {name: max(f[name] for f in found) for name in found[0]} if found else {},
        "library": [state.residuals.largest() for state in states],
    }


def _is_searchable(stated: Problem) -> bool:
    """Whether gaps are linear in all motions, in the plane, and contact nodes are few."""
    nodes = sum(len(_contact_nodes(pair, stated.space)[0]) for pair in stated.pairs)
    linear = all(
        pair.kind == "plane" or (pair.drive != "pushed" and pair.along != "free")
        for pair in stated.sketch.pairs
    )
    return linear and nodes <= 60 and stated.space.mesh.geometry.dim == 2


def _pressed(stated: Problem, states: Sequence[ContactState]) -> list[float]:
    """Largest nodal contact force of each state over the round-off of forces.

    That is of positions and displacements, times the stiffness.
    """
    x = np.abs(stated.space.tabulate_dof_coordinates()).max()
    stiffness = np.abs(stated.K.getValuesCSR()[2]).max()
    lengths = np.array([x + np.abs(state.displacement.array_r).max() for state in states])
    forces = [max(np.abs(pair.force_normal).max() for pair in state.pairs) for state in states]
    return (np.array(forces) / (np.finfo(float).eps * stiffness * lengths)).tolist()


def summary(outcomes: Sequence[dict]) -> str:
    """Counts, iterations, residuals, and what was a bug."""
    iterations = np.array([n for result in outcomes for n in result["iterations"]] or [0])
    alarms = sum(
        residual > 1e-8 and pressed < 1e3
        for result in outcomes
        for pressed, residual in zip(result["pressed"], result["library"], strict=True)
    )
    proved = Counter(result["proved"] for result in outcomes if "proved" in result)
    searched = Counter(f"{r['outcome']}: {r['search']}" for r in outcomes if "search" in r)
    worst = sorted(outcomes, key=lambda result: -result["residual"])[:5]
    counts = dict(Counter(result["outcome"] for result in outcomes))
    forced = sum(result["driven by force"] for result in outcomes)
    tail = f"{np.percentile(iterations, 99):.0f}, largest {iterations.max()}"
    return "\n".join(
        [
            f"{len(outcomes)} seeds, {forced} driven by force: {counts}",
            f"systems of an increment: median {np.median(iterations):.0f}, 99 % up to {tail}",
            f"states without contact force whose own residuals are above 1e-8: {alarms}",
            f"proofs against an equilibrium: {proved[True]}, flawed ones: {proved[False]}",
            f"refusals by a search of all statuses: {dict(searched)}",
            *(f"  {result['residual']:.1e}  {result['description']}" for result in worst),
            *(
                f"{result['outcome']}: {result['message']}\n  {result['description']}"
                for result in outcomes
                if result["outcome"].startswith("BUG")
            ),
        ]
    )


def differences(old: Sequence[dict], new: Sequence[dict], tolerance: float = 1e-9) -> list[str]:
    """Seeds of which another thing came, and how the iterations changed."""
    before = {result["seed"]: result for result in old}
    lines, fewer, more = [], 0, 0
    for b in new:
        a = before.get(b["seed"], b)
        if a["description"] != b["description"]:
            lines.append(f"{b['seed']}: another problem, made by another generator")
            continue
        if a["outcome"] != b["outcome"]:
            lines.append(f"{a['outcome']} -> {b['outcome']}  {b['description']}")
        for k, (x, y) in enumerate(zip(a["norms"], b["norms"], strict=False)):
            if not abs(x - y) <= tolerance * max(abs(x), *map(abs, a["norms"])):
                lines.append(f"{b['seed']}: |a| of increment {k} {x:.10e} -> {y:.10e}")
        pairs = list(zip(a["iterations"], b["iterations"], strict=False))
        fewer += sum(y < x for x, y in pairs)
        more += sum(y > x for x, y in pairs)
        if any(y > x + 5 or y > 2 * x for x, y in pairs):
            lines.append(f"{b['seed']}: iterations {a['iterations']} -> {b['iterations']}")
    return [*lines, f"iterations fewer in {fewer} increments, more in {more}"]


def main(arguments: Sequence[str]) -> int:
    """Solves seeds and prints a table; 1 if there was a bug, a large residual or a flawed proof."""
    parser = argparse.ArgumentParser(prog="python3 -m tests.oracle.outcomes")
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int, help="not included")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, help="file for one JSON line per seed")
    parser.add_argument("--compare", type=Path, help="such a file of another version")
    options = parser.parse_args(arguments)
    outcomes = []
    out = options.out.open("w") if options.out else None
    with get_context("spawn").Pool(options.jobs) as pool:
        for result in pool.imap(outcome, range(options.first, options.last), chunksize=4):
            outcomes.append(result)
            if out:
                print(json.dumps(result), file=out, flush=True)
    print(summary(outcomes))
    if options.compare:
        old = [json.loads(line) for line in options.compare.read_text().splitlines()]
        print(*differences(old, outcomes), sep="\n")
    bugs = any(result["outcome"].startswith("BUG") for result in outcomes)
    bugs |= not all(result.get("proved", True) for result in outcomes)
    return int(bugs or max(result["residual"] for result in outcomes) > 1e-8)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
