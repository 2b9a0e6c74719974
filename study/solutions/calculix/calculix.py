"""CalculiX runs the study's problems.

`python3 -m study.solutions.calculix.calculix [--check] [case ...]`

It needs Python, NumPy and `ccx`, no DOLFINx. Without `--check` it writes the tracked files
`study/solutions/calculix/results/<case>.json`; with it, it runs CalculiX again and compares.
"""

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from study.run.store import write_json
from study.solutions.calculix.decks import Block, HalfBeam, NativePressure, TwoTriangles
from study.solutions.calculix.printed import Array, tables
from study.solutions.calculix.problems import PROBLEMS, Problem

RESULTS = Path(__file__).with_name("results")

# CalculiX prints seven digits; other processors and versions may round otherwise, and iterations
# end elsewhere within their tolerance
TOLERANCE = 1e-5


class PeerError(Exception):
    """CalculiX did not do what it was asked for."""


@dataclass(frozen=True)
class Peer:
    """What CalculiX answered.

    Attributes:
        version: Of CalculiX.
        deck_sha256: Digest of the deck.
        numbers: Arrays by name: `x` and what is known there (forces per thickness of the body,
            in units of the example), or buckling factors times the load.
    """

    version: str
    deck_sha256: str
    numbers: dict[str, Array]


def load(case: str) -> Peer:
    """Read a tracked file."""
    content = json.loads(_path(case).read_bytes())
    numbers = {name: np.array(values) for name, values in content["numbers"].items()}
    return Peer(content["version"], content["deck_sha256"], numbers)


def peer_of(case: str, tracked: str) -> Peer:
    """Read a tracked file that has this digest.

    Raises:
        ValueError: if it has another.
    """
    if tracked != tracked_digest(case):
        raise ValueError(f"the file of {case} has changed since the study was started")
    return load(case)


def tracked_digest(case: str) -> str:
    """Digest of a tracked file, so that results made from it notice its change."""
    return hashlib.sha256(_path(case).read_bytes()).hexdigest()


def digest(deck: str) -> str:
    """Digest of a deck."""
    return hashlib.sha256(deck.encode()).hexdigest()


def executable() -> str | None:
    """Path of CalculiX, or None where it is not installed."""
    return shutil.which("ccx")


def version(ccx: str) -> str:
    """CalculiX's version."""
    said = subprocess.run([ccx, "-v"], capture_output=True, text=True, check=False).stdout
    found = re.search(r"Version (\S+)", said)
    if found is None:
        raise PeerError("ccx -v tells no version")
    return found[1]


def compute(case: str, ccx: str) -> Peer:
    """Run one case in a temporary folder.

    Raises:
        PeerError: if CalculiX fails or prints something else than expected.
    """
    problem = PROBLEMS[case]
    deck = problem.deck()
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder, "job")
        job.with_suffix(".inp").write_text(deck)
        threads = {"OMP_NUM_THREADS": "1"}
        command = [ccx, job.name]
        done = subprocess.run(
            command, cwd=folder, env=os.environ | threads, capture_output=True, text=True
        )
        if done.returncode or "Job finished" not in done.stdout or "*ERROR" in done.stdout:
            raise PeerError(f"{case}: CalculiX failed:\n{done.stdout[-1000:]}{done.stderr}")
        printed = job.with_suffix(getattr(problem, "written", ".dat")).read_text()
    return Peer(version(ccx), digest(deck), _numbers(problem, printed))


def difference(new: Peer, old: Peer) -> float:
    """Largest difference of two answers, each array's over its largest entry."""
    if {n: a.shape for n, a in new.numbers.items()} != {n: a.shape for n, a in old.numbers.items()}:
        return np.inf
    return max(
        float(np.abs(values - old.numbers[name]).max() / np.abs(values).max())
        for name, values in new.numbers.items()
    )


def _numbers(problem: Problem, printed: str) -> dict[str, Array]:
    if isinstance(problem, HalfBeam):
        (factors,) = tables(printed, "FACTOR")
        return {"critical_stress": problem.stress * factors[:, 1]}
    if isinstance(problem, TwoTriangles):
        (forces,) = tables(printed, "forces")
        x = [problem.mesh.nodes[int(node) - 1][0] for node in forces[:, 0]]
        return {"x": np.array(x), "reaction": forces[:, 2]}
    if not isinstance(problem, Block):  # it knows what it wants to be read
        return problem.numbers(printed)
    place = np.array([problem.mesh.nodes[node - 1][0] for node in problem.contact_nodes])
    if isinstance(problem, NativePressure):
        return {"x": place, "pressure": _native_pressure(problem, printed)}
    return {"x": place} | _contact_forces(problem, printed)


def _contact_forces(problem: Block, printed: str) -> dict[str, Array]:
    """Forces on the contact nodes at the end of the last increment: sums over their bricks.

    The bricks are spatial, and carry all of what a node of the plane body does.
    """
    last = tables(printed, "forces")[-1]
    force = {int(row[0]): row[1:] for row in last}
    bricks = np.array([sum(force[node] for node in brick) for brick in problem.bricks()])
    scaled = bricks / (problem.scale * problem.thickness)
    forces = {"force_normal": scaled[:, 1]}
    return forces | ({"force_tangential": scaled[:, 0]} if problem.friction else {})


def _native_pressure(problem: NativePressure, printed: str) -> Array:
    """Mean pressure of the spatial nodes that CalculiX makes of each plane one.

    They are numbered in threes in the order of the plane ones; a corner has three of them, a
    mid-side node the outer two.
    """
    (spatial,) = tables(printed, "contact stress")
    number = spatial[:, 0].astype(int)
    plane = (number - number.min()) // 3
    counts = np.bincount(plane)
    expected = np.where(np.arange(len(problem.contact_nodes)) % 2 == 0, 3, 2)
    if not np.array_equal(counts, expected):
        raise PeerError(
            f"contact nodes expand to {counts.tolist()} nodes, not to 3, 2, 3, 2, ... 3"
        )
    return np.array(np.bincount(plane, spatial[:, 1]) / counts / problem.scale, dtype=np.float64)


def store(case: str, ccx: str) -> None:
    """Run a case and write its tracked file."""
    peer = compute(case, ccx)
    numbers = {
        name: [float(f"{value:.9g}") for value in values] for name, values in peer.numbers.items()
    }
    content = {
        "case": case,
        "program": "CalculiX",
        "version": peer.version,
        "deck_sha256": peer.deck_sha256,
        "numbers": numbers,
    }
    write_json(_path(case), content)


def check(case: str, ccx: str) -> None:
    """Run a case again and compare with its tracked file.

    Raises:
        PeerError: if deck or numbers differ.
    """
    new, old = compute(case, ccx), load(case)
    if new.deck_sha256 != old.deck_sha256:
        raise PeerError(f"{case}: the deck is not that of the tracked file")
    apart = difference(new, old)
    if apart > TOLERANCE:
        said = f"CalculiX {new.version} differs by {apart:.1e} from {old.version} on file"
        raise PeerError(f"{case}: {said}")


def main(arguments: list[str] | None = None) -> int:
    """Store or check the cases; return 0, or 1 if one failed."""
    parser = argparse.ArgumentParser(
        prog="python3 -m study.solutions.calculix.calculix", description=__doc__
    )
    parser.add_argument("cases", nargs="*", metavar="case", help=f"of {', '.join(PROBLEMS)}")
    parser.add_argument("--check", action="store_true", help="compare with the tracked files")
    options = parser.parse_args(arguments)
    unknown = [case for case in options.cases if case not in PROBLEMS]
    if unknown:
        parser.error(f"there is no case {unknown[0]}")
    ccx = executable()
    if ccx is None:
        print("peers: ccx (Debian's package calculix-ccx) is not installed", file=sys.stderr)
        return 1
    act = check if options.check else store
    failed = False
    for case in options.cases or PROBLEMS:
        try:
            act(case, ccx)
            print(f"peers: {case}", file=sys.stderr)
        except (PeerError, OSError) as error:
            print(f"peers: {error}", file=sys.stderr)
            failed = True
    return int(failed)


def _path(case: str) -> Path:
    return RESULTS / f"{case}.json"


if __name__ == "__main__":
    sys.exit(main())
