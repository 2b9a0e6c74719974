"""Facts: statements of the paper that the same mutations turn rest on one fact.

A mutation exchanges an element or a law, a sign, two rows of a table or one printed number, whose
second digit (or only one) is then one less or one more. It is applied to stored results, and all
statements are judged again: those whose verdict, or number if it is one that fails, becomes another
are turned by it.
"""

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from study.judge import claims
from study.judge.claims import PAPER, Claim, Verdict, judge
from study.paper.items import TABLE_1, TABLE_2
from study.run.store import CorruptResult, MissingResult, Results, StoredResult, StudyError

FILE = Path(__file__).parent / "facts.toml"
Rows: TypeAlias = dict[str, tuple[float, ...]]
TABLES: dict[str, Rows] = {"Table 1": TABLE_1, "Table 2": TABLE_2}
Kind = Literal["element", "law", "sign", "row", "print"]


@dataclass(frozen=True)
class Fact:
    """What statements rest on.

    Attributes:
        id: Its name.
        says: It, in words.
        test: A test that shows it without the stored results.
        statements: Ids of one statement that rests on it; of all, if no mutation turns them.
    """

    id: str
    says: str
    test: str
    statements: tuple[str, ...]


@dataclass(frozen=True)
class Mutation:
    """One thing exchanged.

    Attributes:
        name: What, in words.
        kind: Of what kind it is.
        stored: What makes a case's key, or the name of a scalar, that of another one.
        sign: Names of scalars and curves whose sign is changed.
        table: One of `TABLES` that is printed otherwise.
        rows: Two of its rows, which change places, or one with a misprint.
        mode: Where that is.
    """

    name: str
    kind: Kind
    stored: Callable[[str], str] = lambda name: name
    sign: str = ""
    table: str = ""
    rows: tuple[str, ...] = ()
    mode: int = 0


def _exchange(one: str, other: str) -> Callable[[str], str]:
    """Exchange two words that no letter touches."""
    names = {one: other, other: one}
    return lambda text: re.sub(
        rf"(?<![a-zA-Z])({one}|{other})(?![a-zA-Z])", lambda found: names[found[0]], text
    )


def _instead(*pairs: tuple[str, str]) -> Callable[[str], str]:
    def replaced(text: str) -> str:
        for pattern, new in pairs:
            text = re.sub(pattern, new, text)
        return text

    return replaced


_FORM = r"^(7\.6/[a-z]+-[TQ]\d)"


def _other_form(name: str) -> str:
    """Exchange the geometric stiffnesses J, which is named, and G, which is not."""
    if name.startswith(("G_", "J_")):
        return _exchange("G", "J")(name)
    return re.sub(rf"{_FORM}(-J)?", lambda k: k[1] if k[2] else f"{k[1]}-J", name)


COMPUTED = (
    Mutation("standard and new elements exchanged", "element", _exchange("galerkin", "pw")),
    Mutation(
        "composite triangle for the new one", "element", _instead((r"\bpw-T6", "composite-T6"))
    ),
    Mutation("native quadrilateral for the pair", "element", _instead((r"\bpw-Q8", "pw-Q9"))),
    Mutation(
        "new element's matrices symmetrised",
        "law",
        _instead(
            (r"^(7\.[56])/pw-", r"\1/pwsym-"),
            (r"^I/factors-pw-", "I/factors-galerkin-"),
            (r"^pw_(?=\w+_unsymmetry)", "galerkin_"),
            (r"(?<=unsymmetry_)pw$", "galerkin"),
        ),
    ),
    Mutation(
        "consistent mass lumped",
        "law",
        _instead((r"^(7\.5/pw(sym)?-[TQ]\d(-same)?)$", r"\1-lumped")),
    ),
    Mutation("geometric stiffnesses G and J exchanged", "law", _other_form),
    Mutation(
        "friction left out",
        "law",
        _instead((r"^(7\.[34]/[\w-]+[TQ]\d|I/factors-[\w-]+T6)$", r"\1-mu0")),
    ),
    Mutation("tension and compression exchanged", "sign", sign=r"force_|smallest_"),
    Mutation("sign of the geometric stiffness", "sign", sign=r"sigma_cr"),
)
ROWS = tuple(
    Mutation(f"{table}: {one} and {other} exchanged", "row", table=table, rows=(one, other))
    for table, one, other in (
        ("Table 1", "CAX6", "6-node user element"),
        ("Table 1", "CAX8", "8-node user element"),
        ("Table 1", "CAX6", "CAX8"),
        ("Table 2", "CPS6", "6-node user element"),
        ("Table 2", "CPS6", "CPS6M"),
    )
)
PRINTED = tuple(
    Mutation(f"{table}: {row}, mode {mode + 1}", "print", table=table, rows=(row,), mode=mode)
    for table, rows in TABLES.items()
    for row, numbers in rows.items()
    for mode in range(len(numbers))
)
OWN = "printed number "  # with which names of misprints of statements' own numbers begin


def load_facts(path: Path = FILE) -> list[Fact]:
    """Read the facts."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))["fact"]
    return [Fact(**{**table, "statements": tuple(table["statements"])}) for table in tables]


def write(out: Path, verdicts: list[Verdict], results: Results) -> None:
    """Write `<out>/claims.json`, with the facts that statements of the paper rest on."""
    turned = turned_by(verdicts, results)
    facts = facts_of([verdict.claim for verdict in verdicts], turned, load_facts())
    claims.write(out, verdicts, facts, turned)


def turned_by(verdicts: list[Verdict], results: Results) -> dict[str, tuple[str, ...]]:
    """Return the names of the mutations that turn each statement of the paper, by its id.

    Of findings that rest on printed numbers, those of the print.
    """
    judged = [v for v in verdicts if v.claim.judgement and v.measured is not None]
    paper = [v for v in judged if v.claim.kind in PAPER]
    turned: dict[str, list[str]] = {v.claim.id: [] for v in judged}
    for mutation in COMPUTED:
        for name in _turned(paper, _Mutated(results, mutation)):
            turned[name].append(mutation.name)
    for table, rows in TABLES.items():
        any_row = _readers(judged, results, table, rows)
        readers = {row: _readers(any_row, results, table, [row]) for row in rows}
        for mutation in (one for one in (*ROWS, *PRINTED) if one.table == table):
            reading = [v for v in judged if any(v in readers[row] for row in mutation.rows)]
            found: set[str] = set()
            for misprint in _misprints(mutation):
                with _printed(table, misprint):
                    found.update(_turned(reading, results))
            for name in found:
                turned[name].append(mutation.name)
    for verdict in paper:
        if verdict.claim.printed and _own_number(verdict, results):
            turned[verdict.claim.id].append(own_number(verdict.claim))
    return {name: tuple(found) for name, found in turned.items()}


def facts_of(
    statements: list[Claim], turned: Mapping[str, tuple[str, ...]], facts: list[Fact]
) -> dict[str, str]:
    """Return the fact that each statement of the paper rests on, by its id, if there is one.

    Statements share a fact if the same exchanges of elements, laws, signs and rows turn them, or
    of printed numbers if none of these does. What nothing turns, and definitions, are named by
    the fact itself.
    """
    named = {name: fact.id for fact in facts for name in fact.statements}
    paper = [claim for claim in statements if claim.kind in PAPER]
    of = {claim.id: signature(claim, turned.get(claim.id, ())) for claim in paper}
    alike = {of[name]: fact for name, fact in named.items() if of.get(name)}
    found = {name: alike.get(same) if same else named.get(name) for name, same in of.items()}
    return {name: fact for name, fact in found.items() if fact}


def signature(claim: Claim, turned: Sequence[str]) -> frozenset[str]:
    """Return the mutations by which a statement is one fact with others; none of a definition."""
    if claim.basis == "definition":
        return frozenset()
    computed = {one.name for one in COMPUTED}
    prints = {name for name in turned if name.startswith(OWN)} | {one.name for one in PRINTED}
    return frozenset(turned) - (prints if computed & {*turned} else set())


def own_number(claim: Claim) -> str:
    """Return the name of the misprint of a statement's own number."""
    how = claim.judgement
    assert how is not None
    return f"{OWN}{how.value:g}{how.unit and ' '}{how.unit}"


class _Mutated(Results):
    """Results in which a mutation's other case stands for each, if there is one."""

    def __init__(self, results: Results, mutation: Mutation) -> None:
        super().__init__(results.folder)
        self._own, self._mutation = results, mutation

    def __getitem__(self, key: str) -> StoredResult:
        own, other = [self._own[key]], self._mutation.stored(key)
        if other != key:
            with suppress(MissingResult, CorruptResult):
                own.append(self._own[other])
        scalars = {name: value for one in own for name, value in one.scalars.items()}

        def curves() -> dict[str, Any]:
            return self._signed({name: curve for one in own for name, curve in one.curves.items()})

        return replace(own[0], scalars=self._scalars(scalars), unpack=curves)

    def section(self, section: str) -> list[Any]:
        """Return what is read only if a measure wants it."""
        return [_Later(self, stored) for stored in self._own.section(section)]

    def _scalars(self, scalars: Mapping[str, float]) -> dict[str, float]:
        names = {name: self._mutation.stored(name) for name in scalars}
        return self._signed({name: scalars.get(names[name], scalars[name]) for name in scalars})

    def _signed(self, numbers: Mapping[str, Any]) -> dict[str, Any]:
        sign = self._mutation.sign
        return {
            name: -value if sign and re.match(sign, name) else value
            for name, value in numbers.items()
        }


class _Later:
    """A stored result that is read when its numbers are asked for."""

    has = StoredResult.has

    def __init__(self, results: Results, stored: StoredResult) -> None:
        self._results = results
        self.key, self.section, self.case = stored.key, stored.section, stored.case
        self.parameters = stored.parameters

    def __getattr__(self, name: str) -> object:
        return getattr(self._results[self.key], name)


def _turned(verdicts: list[Verdict], results: Results) -> list[str]:
    """Ids of those that have another verdict now; not of those that find nothing to measure."""

    def another(before: Verdict) -> bool:
        try:
            (one,) = judge([before.claim], results)
        except StudyError:
            return False
        changed = (one.verdict, one.differs) != (before.verdict, before.differs)
        return changed and one.measured is not None

    return [verdict.claim.id for verdict in verdicts if another(verdict)]


@contextmanager
def _printed(table: str, rows: Rows) -> Iterator[None]:
    before = dict(TABLES[table])
    try:
        TABLES[table].update(rows)
        yield
    finally:
        TABLES[table].update(before)


def _misprints(mutation: Mutation) -> list[Rows]:
    table, mode = TABLES[mutation.table], mutation.mode
    if mutation.kind == "row":
        one, other = mutation.rows
        return [{one: table[other], other: table[one]}]
    (row,) = mutation.rows
    return [
        {row: (*table[row][:mode], wrong, *table[row][mode + 1 :])}
        for wrong in misread(table[row][mode])
    ]


def misread(number: float) -> tuple[float, float]:
    """Return a number whose second digit, or only one, is one less, and one more."""
    digits = f"{number:.15g}".replace(".", "").strip("0").partition("e")[0]
    power = int(f"{number:e}".partition("e")[2])
    unit = 10.0 ** (power - (len(digits) > 1))
    return number - unit, number + unit


def _readers(
    verdicts: list[Verdict], results: Results, table: str, rows: Iterable[str]
) -> list[Verdict]:
    """Those whose number hangs on rows: other rows give another one."""
    strange = {
        row: tuple((1.3 + 0.1 * i + 0.07 * k) * x for i, x in enumerate(TABLES[table][row]))
        for k, row in enumerate(rows)
    }
    with _printed(table, strange):
        again = judge([v.claim for v in verdicts], results)
    return [v for v, one in zip(verdicts, again, strict=True) if v.measured != one.measured]


def _own_number(verdict: Verdict, results: Results) -> bool:
    how = verdict.claim.judgement
    assert how is not None
    others = [
        replace(verdict.claim, judgement=replace(how, value=wrong)) for wrong in misread(how.value)
    ]
    return any(one.verdict != verdict.verdict for one in judge(others, results))
