"""Draw forty random mutants of the library, by a fixed seed, and test which the suite detects.

Mutants whose expressions no longer exist are skipped.

    ./run pip install pytest-cov
    ./run python3 -m tests.mutants draw           # writes tests/mutants.json
    ./run python3 -m tests.mutants cover          # run the suite; record the lines of each test
    ./run python3 -m tests.mutants run OUT.json   # each mutant against the tests that cover it

A mutant changes the sign, factor, index, comparison or tolerance in one expression of
`pw_elements`. It is identified by its function and its text and can therefore be found after lines
have moved. Each mutant is tested in a copy of the tree, with the fastest tests first, until a test
fails; it counts as timed out after `CPU_LIMIT` seconds.
"""

import argparse
import ast
import json
import os
import random
import resource
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
MUTANTS_FILE = Path(__file__).with_suffix(".json")
COVERAGE_FILE = ROOT / ".cache" / "mutants.coverage"
DURATIONS_FILE = COVERAGE_FILE.with_suffix(".xml")  # durations of the tests
SEED, MUTANTS_PER_KIND = 20261122, 8
KINDS = ("sign", "factor", "index", "comparison", "tolerance")
MAX_TOLERANCE = 1e-3  # positive constants below this value are tolerances
OPPOSITE_OPERATOR = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
CPU_LIMIT = 240  # CPU seconds for the tests of a mutant


class Mutant(NamedTuple):
    """One changed expression; `place` is its index among the function's mutants of its kind."""

    kind: str
    module: str
    function: str
    place: int
    old: str
    new: str


def mutate_expression(node: ast.AST) -> tuple[str, ast.expr] | None:
    """Return the kind of mutation and the changed expression, or None if there is none."""
    match node:
        case ast.BinOp(left, ast.Add() | ast.Sub() as op, right):
            return "sign", ast.BinOp(left, OPPOSITE_OPERATOR[type(op)](), right)
        case ast.UnaryOp(ast.USub(), operand) if not isinstance(operand, ast.Constant):
            return "sign", operand
        case ast.BinOp(left, ast.Mult() | ast.Div() as op, right):
            return "factor", ast.BinOp(left, OPPOSITE_OPERATOR[type(op)](), right)
        case ast.Subscript(value, ast.Constant(int() as i)) if not isinstance(i, bool):
            return "index", ast.Subscript(value, ast.Constant(1 if i == 0 else 0), ast.Load())
        case ast.Compare(left, [op], [right]) if type(op) in OPPOSITE_OPERATOR:
            return "comparison", ast.Compare(left, [OPPOSITE_OPERATOR[type(op)]()], [right])
        case ast.Constant(float() as x) if 0.0 < x < MAX_TOLERANCE:
            return "tolerance", ast.Constant(1e4 * x)
    return None


def find_mutants(module: Path) -> Iterator[tuple[Mutant, ast.expr]]:
    """Yield all mutants of a module, each with the node of the expression to replace."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    counts: dict[tuple[str, str], int] = {}

    def walk_expressions(node: ast.AST, function_name: str) -> Iterator[tuple[Mutant, ast.expr]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                body = child.body
                inner_name = f"{function_name}.{child.name}".lstrip(".")
                for statement in body:
                    yield from walk_expressions(ast.Module([statement], []), inner_name)
                continue
            if isinstance(child, ast.arguments | ast.Raise | ast.JoinedStr | ast.AnnAssign):
                continue  # messages and annotations
            if isinstance(child, ast.expr) and (change := mutate_expression(child)):
                kind, mutated = change
                index = counts[kind, function_name] = counts.get((kind, function_name), -1) + 1
                path = str(module.relative_to(ROOT))
                yield (
                    Mutant(
                        kind, path, function_name, index, ast.unparse(child), ast.unparse(mutated)
                    ),
                    child,
                )
            yield from walk_expressions(child, function_name)

    yield from walk_expressions(tree, "")


def draw_mutants() -> list[Mutant]:
    """Return `MUTANTS_PER_KIND` random mutants of each kind."""
    candidates = [
        mutant
        for module in sorted((ROOT / "pw_elements").rglob("*.py"))
        for mutant, _ in find_mutants(module)
        # tolerances at the top of a module are named constants
        if mutant.function or mutant.kind == "tolerance"
    ]
    rng = random.Random(SEED)
    return [
        mutant
        for kind in KINDS
        for mutant in rng.sample(
            [mutant for mutant in candidates if mutant.kind == kind], MUTANTS_PER_KIND
        )
    ]


def apply_mutant(mutant: Mutant) -> tuple[str, set[int]] | None:
    """Return the changed module text and its lines, or None if the expression no longer exists."""
    path = ROOT / mutant.module
    for candidate, node in find_mutants(path) if path.is_file() else ():
        if (candidate.kind, *candidate[2:5]) == (mutant.kind, *mutant[2:5]):
            lines = path.read_bytes().splitlines(keepends=True)
            start, end = node.lineno - 1, (node.end_lineno or node.lineno) - 1
            head = b"".join(lines[:start]) + lines[start][: node.col_offset]
            tail = lines[end][node.end_col_offset :] + b"".join(lines[end + 1 :])
            text = (head + f"({mutant.new})".encode() + tail).decode()
            if mutant.function:
                return text, set(range(start + 1, end + 2))
            return text, find_uses_of_constant(path, start + 1)
    return None


def find_uses_of_constant(path: Path, line: int) -> set[int]:
    """Return the lines that use the constant defined by a line at the top of a module."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    (names,) = [
        {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}
        for statement in tree.body
        if statement.lineno <= line <= (statement.end_lineno or line)
    ]
    loads = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id in names]
    return {node.lineno for node in loads if isinstance(node.ctx, ast.Load)}


def measure_coverage() -> None:
    """Run the suite once; store which test executes which line, and the test durations."""
    COVERAGE_FILE.parent.mkdir(exist_ok=True)
    COVERAGE_FILE.unlink(missing_ok=True)
    environment = os.environ | {"COVERAGE_FILE": str(COVERAGE_FILE), "COVERAGE_CORE": "ctrace"}
    options = [
        "--cov=pw_elements",
        "--cov-context=test",
        "--cov-report=",
        f"--junitxml={DURATIONS_FILE}",
    ]
    subprocess.run([sys.executable, "-m", "pytest", *options, "-n", "2"], cwd=ROOT, env=environment)


def read_test_durations() -> dict[str, float]:
    """Return the duration of each test in seconds, by its name without the file."""
    cases = ElementTree.parse(DURATIONS_FILE).iter("testcase")
    return {case.attrib["name"]: float(case.attrib["time"]) for case in cases}


def find_covering_tests(mutant: Mutant, lines: set[int]) -> list[str]:
    """Return the tests that execute one of the lines, the fastest first."""
    from coverage.numbits import numbits_to_nums

    with sqlite3.connect(COVERAGE_FILE) as database:
        rows = database.execute(
            "select context.context, line_bits.numbits from line_bits"
            " join context on context.id = line_bits.context_id"
            " join file on file.id = line_bits.file_id where file.path like ?",
            (f"%/{mutant.module}",),
        ).fetchall()
    contexts = [name for name, bits in rows if lines & set(numbits_to_nums(bits))]
    tests = {context.split("|")[0] for context in contexts if context}
    seconds = read_test_durations()
    return sorted(tests, key=lambda test: (seconds.get(test.split("::")[-1], 0.0), test))


def judge_mutant(mutant: Mutant, folder: Path) -> dict[str, object]:
    """Run the tests that cover a mutant in a copy of the tree; return its record."""
    change = apply_mutant(mutant)
    if change is None:
        return {**mutant._asdict(), "verdict": "gone", "tests": 0}
    text, lines = change
    tests = find_covering_tests(mutant, lines)
    if not tests:
        return {**mutant._asdict(), "verdict": "not covered", "tests": 0}
    module = folder / mutant.module
    module.write_text(text, encoding="utf-8")
    tests_file = folder / "chosen"  # a file, because a command line may be too short for all names
    tests_file.write_text("\n".join(tests), encoding="utf-8")
    options = ["-x", "-n", "0", "-rfE", "-p", "no:cacheprovider", f"@{tests_file}"]
    start_times = os.times()
    process = subprocess.run(
        [sys.executable, "-m", "pytest", *options],
        cwd=folder,
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT, CPU_LIMIT)),
    )  # the limit applies to each process separately
    end_times = os.times()
    shutil.copyfile(ROOT / mutant.module, module)
    if "not found:" in process.stderr:
        raise SystemExit(process.stderr)
    code = process.returncode  # 2 if the mutant cannot be imported
    verdict = "timed out" if code < 0 else "survived" if code == 0 else "caught"
    return {
        **mutant._asdict(),
        "verdict": verdict,
        "tests": len(tests),
        "seconds": round(sum(end_times[2:4]) - sum(start_times[2:4]), 1),
        "by": next(
            (line for line in process.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))),
            "",
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("draw", "cover", "run"))
    parser.add_argument("out", nargs="?", type=Path)
    options = parser.parse_args()
    if options.what == "draw":
        rows = [mutant._asdict() for mutant in draw_mutants()]
        lines = ",\n".join(map(json.dumps, rows))
        MUTANTS_FILE.write_text(f'{{"seed": {SEED}, "mutants": [\n{lines}\n]}}\n')
    elif options.what == "cover":
        measure_coverage()
    else:
        run_mutants(options.out)


def run_mutants(out: Path | None) -> None:
    """Judge all mutants, print one line for each, and write the records to `out`."""
    mutants = [Mutant(**row) for row in json.loads(MUTANTS_FILE.read_text())["mutants"]]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "tree"
        excluded_names = {"results", ".git", ".cache"}  # ignored only at the top of the project
        shutil.copytree(
            ROOT,
            folder,
            ignore=lambda folder_name, _: excluded_names if Path(folder_name) == ROOT else set(),
        )
        results = []
        for number, mutant in enumerate(mutants, start=1):
            results.append(judge_mutant(mutant, folder))
            change = f"{mutant.module}: {mutant.function}: {mutant.old} -> {mutant.new}"
            verdict_column = f"[{number:2}/{len(mutants)}] {results[-1]['verdict']:11}"
            print(f"{verdict_column} {mutant.kind:10} {change}", flush=True)
            if out:
                out.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
