"""Forty mutants of the library, drawn by a seed: which of them does the suite catch?

Those whose expressions have gone since are left out.

    ./run pip install pytest-cov
    ./run python3 -m tests.mutants draw           # writes tests/mutants.json
    ./run python3 -m tests.mutants cover          # which test enters which line: the suite, once
    ./run python3 -m tests.mutants run OUT.json   # each mutant against the tests that cover it

A mutant is one expression of a statement of `pw_elements` with another sign, factor, index,
comparison or tolerance. It is named by its function and its text, so that it is found again after
lines have moved. Each runs in a copy of the tree, the quickest tests first, stops at the first that
fails, and counts as timed out after `LIMIT` seconds of CPU.
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
DRAWN = Path(__file__).with_suffix(".json")
COVERED = ROOT / ".cache" / "mutants.coverage"
TIMES = COVERED.with_suffix(".xml")  # of each test
SEED, EACH = 20261122, 8
KINDS = ("sign", "factor", "index", "comparison", "tolerance")
SMALL = 1e-3  # a positive constant below this is a tolerance
OTHER = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
LIMIT = 240  # seconds of CPU of a mutant's tests


class Mutant(NamedTuple):
    """One changed expression; its place is its number among those of its kind in the function."""

    kind: str
    module: str
    function: str
    place: int
    old: str
    new: str


def changed(node: ast.AST) -> tuple[str, ast.expr] | None:
    """Return the kind of change that an expression allows, and the changed expression."""
    match node:
        case ast.BinOp(left, ast.Add() | ast.Sub() as op, right):
            return "sign", ast.BinOp(left, OTHER[type(op)](), right)
        case ast.UnaryOp(ast.USub(), operand) if not isinstance(operand, ast.Constant):
            return "sign", operand
        case ast.BinOp(left, ast.Mult() | ast.Div() as op, right):
            return "factor", ast.BinOp(left, OTHER[type(op)](), right)
        case ast.Subscript(value, ast.Constant(int() as i)) if not isinstance(i, bool):
            return "index", ast.Subscript(value, ast.Constant(1 if i == 0 else 0), ast.Load())
        case ast.Compare(left, [op], [right]) if type(op) in OTHER:
            return "comparison", ast.Compare(left, [OTHER[type(op)]()], [right])
        case ast.Constant(float() as x) if 0.0 < x < SMALL:
            return "tolerance", ast.Constant(1e4 * x)
    return None


def sites(module: Path) -> Iterator[tuple[Mutant, ast.expr]]:
    """Yield all mutants of a module, each with the expression to replace."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    counts: dict[tuple[str, str], int] = {}

    def walk(node: ast.AST, name: str) -> Iterator[tuple[Mutant, ast.expr]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                body = child.body
                inner = f"{name}.{child.name}".lstrip(".")
                for one in body:
                    yield from walk(ast.Module([one], []), inner)
                continue
            if isinstance(child, ast.arguments | ast.Raise | ast.JoinedStr | ast.AnnAssign):
                continue  # messages and annotations
            if isinstance(child, ast.expr) and (change := changed(child)):
                kind, other = change
                place = counts[kind, name] = counts.get((kind, name), -1) + 1
                path = str(module.relative_to(ROOT))
                yield (
                    Mutant(kind, path, name, place, ast.unparse(child), ast.unparse(other)),
                    child,
                )
            yield from walk(child, name)

    yield from walk(tree, "")


def draw() -> list[Mutant]:
    found = [
        mutant
        for module in sorted((ROOT / "pw_elements").rglob("*.py"))
        for mutant, _ in sites(module)
        if mutant.function or mutant.kind == "tolerance"  # which have names at the module's head
    ]
    dice = random.Random(SEED)
    return [
        mutant
        for kind in KINDS
        for mutant in dice.sample([one for one in found if one.kind == kind], EACH)
    ]


def applied(mutant: Mutant) -> tuple[str, set[int]] | None:
    """Return the module's text with the change, and its lines; None if the expression is gone."""
    path = ROOT / mutant.module
    for other, node in sites(path) if path.is_file() else ():
        if (other.kind, *other[2:5]) == (mutant.kind, *mutant[2:5]):
            lines = path.read_bytes().splitlines(keepends=True)
            first, last = node.lineno - 1, (node.end_lineno or node.lineno) - 1
            head = b"".join(lines[:first]) + lines[first][: node.col_offset]
            tail = lines[last][node.end_col_offset :] + b"".join(lines[last + 1 :])
            text = (head + f"({mutant.new})".encode() + tail).decode()
            return text, set(range(first + 1, last + 2)) if mutant.function else used(
                path, first + 1
            )
    return None


def used(path: Path, line: int) -> set[int]:
    """Return the lines that use the constant which a line at a module's head defines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    (names,) = [
        {one.id for one in ast.walk(statement) if isinstance(one, ast.Name)}
        for statement in tree.body
        if statement.lineno <= line <= (statement.end_lineno or line)
    ]
    loads = [one for one in ast.walk(tree) if isinstance(one, ast.Name) and one.id in names]
    return {one.lineno for one in loads if isinstance(one.ctx, ast.Load)}


def cover() -> None:
    COVERED.parent.mkdir(exist_ok=True)
    COVERED.unlink(missing_ok=True)
    environment = os.environ | {"COVERAGE_FILE": str(COVERED), "COVERAGE_CORE": "ctrace"}
    options = ["--cov=pw_elements", "--cov-context=test", "--cov-report=", f"--junitxml={TIMES}"]
    subprocess.run([sys.executable, "-m", "pytest", *options, "-n", "2"], cwd=ROOT, env=environment)


def durations() -> dict[str, float]:
    """Return the seconds that each test took, by its last name."""
    cases = ElementTree.parse(TIMES).iter("testcase")
    return {one.attrib["name"]: float(one.attrib["time"]) for one in cases}


def covering(mutant: Mutant, lines: set[int]) -> list[str]:
    """Return the tests that enter one of the lines."""
    from coverage.numbits import numbits_to_nums

    with sqlite3.connect(COVERED) as base:
        rows = base.execute(
            "select context.context, line_bits.numbits from line_bits"
            " join context on context.id = line_bits.context_id"
            " join file on file.id = line_bits.file_id where file.path like ?",
            (f"%/{mutant.module}",),
        ).fetchall()
    hit = [name for name, bits in rows if lines & set(numbits_to_nums(bits))]
    tests = {name.split("|")[0] for name in hit if name}
    seconds = durations()
    return sorted(tests, key=lambda test: (seconds.get(test.split("::")[-1], 0.0), test))


def verdict(mutant: Mutant, folder: Path) -> dict[str, object]:
    """Run the tests that cover a mutant, in a copy of the tree."""
    changed_text = applied(mutant)
    if changed_text is None:
        return {**mutant._asdict(), "verdict": "gone", "tests": 0}
    text, lines = changed_text
    tests = covering(mutant, lines)
    if not tests:
        return {**mutant._asdict(), "verdict": "not covered", "tests": 0}
    module = folder / mutant.module
    module.write_text(text, encoding="utf-8")
    chosen = folder / "chosen"  # a file, for names may be more than a command line holds
    chosen.write_text("\n".join(tests), encoding="utf-8")
    options = ["-x", "-n", "0", "-rfE", "-p", "no:cacheprovider", f"@{chosen}"]
    began = os.times()
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options],
        cwd=folder,
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT)),
    )  # children have limits of their own
    ended = os.times()
    shutil.copyfile(ROOT / mutant.module, module)
    if "not found:" in done.stderr:
        raise SystemExit(done.stderr)
    code = done.returncode  # 2 where the mutant cannot even be imported
    words = "timed out" if code < 0 else "survived" if code == 0 else "caught"
    return {
        **mutant._asdict(),
        "verdict": words,
        "tests": len(tests),
        "seconds": round(sum(ended[2:4]) - sum(began[2:4]), 1),
        "by": next((x for x in done.stdout.splitlines() if x.startswith(("FAILED", "ERROR"))), ""),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("draw", "cover", "run"))
    parser.add_argument("out", nargs="?", type=Path)
    options = parser.parse_args()
    if options.what == "draw":
        rows = [mutant._asdict() for mutant in draw()]
        lines = ",\n".join(map(json.dumps, rows))
        DRAWN.write_text(f'{{"seed": {SEED}, "mutants": [\n{lines}\n]}}\n')
    elif options.what == "cover":
        cover()
    else:
        judge(options.out)


def judge(out: Path | None) -> None:
    mutants = [Mutant(**row) for row in json.loads(DRAWN.read_text())["mutants"]]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "tree"
        made = {"results", ".git", ".cache"}  # in the project's own folder alone
        shutil.copytree(ROOT, folder, ignore=lambda at, _: made if Path(at) == ROOT else set())
        results = []
        for number, mutant in enumerate(mutants, start=1):
            results.append(verdict(mutant, folder))
            change = f"{mutant.module}: {mutant.function}: {mutant.old} -> {mutant.new}"
            head = f"[{number:2}/{len(mutants)}] {results[-1]['verdict']:11}"
            print(f"{head} {mutant.kind:10} {change}", flush=True)
            if out:
                out.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
