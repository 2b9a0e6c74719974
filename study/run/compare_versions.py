"""Compare all scalars of two folders of results, e.g. from two versions of DOLFINx.

`python3 -m study.run.compare_versions results results-sid` prints the largest difference for each
kind of scalar. The exit status is 1 if a difference is too large, or if only one of the folders
contains a case or scalar. To compare results before and after a redesign, use `--tolerance 1e-9`,
which sets one tolerance for all kinds of scalars except the numbers of iterations.
"""

import argparse
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from study.run.cases import SECTIONS
from study.run.store import Results, StoredResult, StudyError


@dataclass(frozen=True)
class ScalarKind:
    """Kind of scalars that are compared with the same tolerance.

    Attributes:
        name: Name of the kind.
        pattern: Regular expression for "section/case scalar"; matching scalars belong to the kind.
        scale: Value by which differences are divided: "value" is the larger absolute value of the
            two scalars, "case" is the largest absolute value of this kind in the case, and "one" is
            like "value", but at least 1.
        tolerance: Largest accepted difference after this division.
        why: Reason why the tolerance is not smaller.
    """

    name: str
    pattern: str
    scale: Literal["value", "case", "one"]
    tolerance: float
    why: str


KINDS: tuple[ScalarKind, ...] = (
    ScalarKind(
        "numbers on Gmsh's meshes",
        r"^C/.*-(curved-ring|ball)\b",
        "value",
        2e-4,
        "versions of Gmsh move some nodes",
    ),
    ScalarKind(
        "numbers on Gmsh's tetrahedra",
        r"^V15/cube-.*-T10-|^V12/frequency-cube\S* order",
        "value",
        0.1,
        "versions of Gmsh make other tetrahedra; set after 4 % had been seen",
    ),
    ScalarKind(
        "motions that grow",
        r"^V12/bar-\dd-pw-",
        "value",
        1e-4,
        "so does round-off; set after 2e-6 had been seen",
    ),
    ScalarKind(
        "counts of Krylov's iterations",
        r" krylov_iterations",
        "value",
        0.1,
        "round-off may make one more",
    ),
    ScalarKind(
        "residuals and identities",
        r" .*(residual|difference|penetration|imaginary|unevenness|control_|change|zero|balance)"
        r"| (objectivity|moment_defect|base_defect|last_correction|slave_force_least)",
        "one",
        1e-7,
        "they are round-off, which depends on the way a solver takes; the tests allow them this",
    ),
    ScalarKind(
        "ends of zones",
        r" (closed_from|closed_to)$",
        "case",
        1e-8,
        "places, some of which are zero but for round-off",
    ),
    ScalarKind(
        "rates of Newton's method",
        r" newton_rate",
        "value",
        1e-2,
        "the last of its corrections are near round-off; set after 3e-3 between two processors",
    ),
    ScalarKind(
        "orders",
        r" .*order\b| order_",
        "one",
        1e-4,
        "they are slopes through errors, the smallest of which is 3e-10 and so half round-off",
    ),
    ScalarKind(
        "errors",
        r" error| .*_error(_[a-z]+)*$| \w*_uncertainty$| pressure_l2| variation| master_force_"
        r"|^P/\S+ (exact|reduced)_",
        "one",
        1e-8,
        "they are relative, so that this is the relative difference of what they are errors of",
    ),
    ScalarKind(
        "forces", r" (force|acceleration)_", "case", 1e-8, "some of them are zero but for round-off"
    ),
    ScalarKind("all others", "", "value", 1e-8, "conditioning of the systems times round-off"),
)
"""Kinds of scalars; each scalar belongs to the first kind whose pattern it matches."""


COUNTS_AND_TIMES = ScalarKind(
    "counts of iterations, and times",
    r" (krylov_)?iterations| factorisations| cpu_seconds",
    "value",
    float("inf"),
    "another way to the same solution may be longer or shorter",
)

RECORD_KINDS: tuple[ScalarKind, ...] = (
    ScalarKind(
        "times, memory, and counts that depend on solver and machine",
        r"^K/\S+ (\w*seconds|megabytes|over_linear|digits|entries)$",
        "value",
        float("inf"),
        "they are measured, not computed",
    ),
    ScalarKind(
        "counts and norms of measured solutions",
        r"^K/\S+ (?!difference)",
        "value",
        1e-5,
        "the Krylov solver is exact to its tolerance; set before a value was seen",
    ),
)
"""Kinds of the scalars that section K measures."""


def scalar_kinds_with_equal_tolerance(tolerance: float) -> tuple[ScalarKind, ...]:
    """Return all kinds of scalars with one tolerance, for results of identical versions.

    Numbers of iterations and computing times keep their infinite tolerance.
    """
    return (COUNTS_AND_TIMES, *(replace(kind, tolerance=tolerance) for kind in KINDS))


@dataclass(frozen=True)
class ScalarDifference:
    """Difference of one scalar between two folders of results.

    Attributes:
        kind: Kind of the scalar.
        key: Key of the case.
        name: Name of the scalar.
        first_value: Value in the first folder.
        second_value: Value in the second folder.
        size: Absolute difference, divided by the value that `ScalarKind.scale` defines.
    """

    kind: ScalarKind
    key: str
    name: str
    first_value: float
    second_value: float
    size: float

    @property
    def too_large(self) -> bool:
        """Whether the difference exceeds the tolerance of the kind."""
        return not self.size <= self.kind.tolerance


def compare_scalars_of_folders(
    first: Results,
    second: Results,
    kinds: tuple[ScalarKind, ...] = KINDS,
    second_may_lack_cases: bool = False,
) -> tuple[list[ScalarDifference], list[str]]:
    """Compare all scalars of two folders of results.

    Args:
        first: Results of the first folder.
        second: Results of the second folder.
        kinds: Kinds of scalars, with their tolerances.
        second_may_lack_cases: Whether the second folder may lack cases of the first.

    Returns:
        Differences of all scalars that both folders contain, and names of cases and scalars that
        only one folder contains.
    """
    differences: list[ScalarDifference] = []
    unpaired: list[str] = []
    for section in SECTIONS:
        cases = [{case.key: case for case in one.section(section)} for one in (first, second)]
        unpaired += sorted(cases[1].keys() - cases[0].keys())
        unpaired += [] if second_may_lack_cases else sorted(cases[0].keys() - cases[1].keys())
        for key in sorted(cases[0].keys() & cases[1].keys()):
            one, other = cases[0][key], cases[1][key]
            unpaired += [
                f"{key} {name}" for name in sorted(one.scalars.keys() ^ other.scalars.keys())
            ]
            differences += _compare_scalars_of_case(one, other, kinds)
    return differences, unpaired


def _compare_scalars_of_case(
    first_result: StoredResult, second_result: StoredResult, all_kinds: tuple[ScalarKind, ...]
) -> Iterator[ScalarDifference]:
    common = [name for name in first_result.scalars if name in second_result.scalars]
    kinds = {name: find_kind_of_scalar(f"{first_result.key} {name}", all_kinds) for name in common}
    size = {
        name: max(abs(first_result.scalars[name]), abs(second_result.scalars[name]))
        for name in common
    }
    for name, kind in kinds.items():
        largest = max(size[like] for like in common if kinds[like] is kind)
        scale = {"value": size[name], "case": largest, "one": max(1.0, size[name])}[kind.scale]
        a, b = first_result.scalars[name], second_result.scalars[name]
        yield ScalarDifference(
            kind, first_result.key, name, a, b, abs(a - b) / scale if a != b else 0.0
        )


def find_kind_of_scalar(
    key_and_scalar_name: str, kinds: tuple[ScalarKind, ...] = KINDS
) -> ScalarKind:
    """Return the first kind whose pattern matches a scalar, given as "section/case name"."""
    return next(kind for kind in kinds if re.search(kind.pattern, key_and_scalar_name))


def format_differences(
    differences: list[ScalarDifference],
    unpaired_names: list[str],
    kinds: tuple[ScalarKind, ...] = KINDS,
) -> str:
    """Format the largest difference of each kind, all excessive differences, and unpaired names.

    Args:
        differences: Differences from `compare_scalars_of_folders`.
        unpaired_names: Names of cases and scalars that only one folder contains.
        kinds: Kinds of scalars, in the order of the text.
    """
    lines = []
    for kind in kinds:
        of_kind = sorted((d for d in differences if d.kind is kind), key=lambda d: -d.size)
        if of_kind:
            scales = {
                "value": "relative",
                "case": "over the case's largest",
                "one": "over 1 or itself",
            }
            lines.append(
                f"{kind.name}: {len(of_kind)}, largest difference {of_kind[0].size:.1e} "
                f"({scales[kind.scale]}; at most {kind.tolerance:.0e}: {kind.why})"
            )
            shown = [d for d in of_kind if d.too_large] or of_kind[:1]
            lines += [
                f"{'  TOO LARGE' if d.too_large else '  largest'}: {d.key} {d.name} "
                f"{d.first_value:.12g} and {d.second_value:.12g}"
                for d in shown
            ]
    return "\n".join([*lines, *(f"in one folder only: {name}" for name in unpaired_names)])


def main(arguments: list[str] | None = None) -> int:
    """Compare two folders of results, and print the differences.

    Args:
        arguments: Command-line arguments; by default, those of this process.

    Returns:
        Exit status: 0 if all scalars agree; 1 if a difference is too large, or if a case or scalar
        is in one folder only; 2 if results cannot be read.
    """
    parser = argparse.ArgumentParser(prog="study.run.compare_versions", description=__doc__)
    parser.add_argument("folders", nargs=2, type=Path, metavar="DIR")
    parser.add_argument(
        "--tolerance", type=float, metavar="T", help="of all kinds but counts of iterations"
    )
    parser.add_argument(
        "--subset", action="store_true", help="the second folder may lack cases of the first"
    )
    options = parser.parse_args(arguments)
    folders = options.folders
    kinds = (
        KINDS if options.tolerance is None else scalar_kinds_with_equal_tolerance(options.tolerance)
    )
    try:
        results = [Results(folder) for folder in folders]
        for folder, one in zip(folders, results, strict=True):
            print(f"{folder}: {', '.join(_list_dolfinx_and_petsc_versions(one)) or 'nothing'}")
        differences, unpaired = compare_scalars_of_folders(
            results[0], results[1], kinds, options.subset
        )
    except StudyError as error:
        print(f"study.run.compare_versions: {error}", file=sys.stderr)
        return 2
    print(format_differences(differences, unpaired, kinds))
    n_wrong = sum(d.too_large for d in differences) + len(unpaired)
    print(
        f"{len(differences)} scalars: {n_wrong} differ" if differences else "there are no scalars"
    )
    return int(n_wrong > 0 or not differences)


def _list_dolfinx_and_petsc_versions(results: Results) -> list[str]:
    """Return the versions of DOLFINx and PETSc with which the results were computed."""
    names = set()
    for section in SECTIONS:
        for case in results.section(section):
            versions = case.provenance.get("versions", {})
            names.add(f"DOLFINx {versions.get('dolfinx')}, PETSc {versions.get('petsc')}")
    return sorted(names)


if __name__ == "__main__":
    sys.exit(main())
