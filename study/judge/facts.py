"""Facts on which statements of the paper rest, found by mutations of the results.

A mutation exchanges elements, laws, signs or two rows of a printed table, or alters one printed
number by one unit of its second digit (of its first, if it has only one). It is applied to the
stored results, and all statements are judged again. It reverses ("turns") a statement if the
statement's verdict changes, or, for a statement that fails, the number found. Statements that the
same mutations reverse rest on the same fact.
"""

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from study.judge import claims
from study.judge.claims import PAPER_KINDS, Claim, Verdict, judge
from study.paper.items import TABLE_1, TABLE_2
from study.run.store import CorruptResult, MissingResult, Results, StoredResult, StudyError

FACTS_FILE = Path(__file__).parent / "facts.toml"
TableRows: TypeAlias = dict[str, tuple[float, ...]]
PRINTED_TABLES: dict[str, TableRows] = {"Table 1": TABLE_1, "Table 2": TABLE_2}
MutationKind = Literal["element", "law", "sign", "row", "print"]


@dataclass(frozen=True)
class Fact:
    """Fact on which one or more statements rest.

    Attributes:
        id: Name of the fact.
        says: Description of the fact.
        test: Test that demonstrates the fact without stored results.
        statements: Id of one statement that rests on the fact, or ids of all such statements if no
            mutation reverses them.
    """

    id: str
    says: str
    test: str
    statements: tuple[str, ...]


@dataclass(frozen=True)
class Mutation:
    """A single change of stored results or of printed numbers.

    Attributes:
        name: Description of the mutation.
        kind: Kind of the mutation.
        rename_stored: Function that replaces the key of a case or the name of a scalar by that of
            the case or scalar to be used instead.
        sign_pattern: Regular expression for names of scalars and curves whose signs are reversed.
        table: Name of the table in `PRINTED_TABLES` that is altered.
        rows: Two rows of the table to exchange, or one row with a misprint.
        mode_index: Position of the misprint in its row.
    """

    name: str
    kind: MutationKind
    rename_stored: Callable[[str], str] = lambda name: name
    sign_pattern: str = ""
    table: str = ""
    rows: tuple[str, ...] = ()
    mode_index: int = 0


def _exchange_words(first: str, second: str) -> Callable[[str], str]:
    """Return a function that exchanges two words unless they are part of longer words."""
    replacements = {first: second, second: first}
    return lambda text: re.sub(
        rf"(?<![a-zA-Z])({first}|{second})(?![a-zA-Z])", lambda match: replacements[match[0]], text
    )


def _replace_patterns(*pairs: tuple[str, str]) -> Callable[[str], str]:
    def replace_all(text: str) -> str:
        for pattern, replacement in pairs:
            text = re.sub(pattern, replacement, text)
        return text

    return replace_all


_BUCKLING_CASE_PATTERN = r"^(7\.6/[a-z]+-[TQ]\d)"


def _exchange_forms(name: str) -> str:
    """Exchange the geometric stiffnesses J and G in a name; keys of cases omit G."""
    if name.startswith(("G_", "J_")):
        return _exchange_words("G", "J")(name)
    return re.sub(
        rf"{_BUCKLING_CASE_PATTERN}(-J)?",
        lambda match: match[1] if match[2] else f"{match[1]}-J",
        name,
    )


RESULT_MUTATIONS = (
    Mutation("standard and new elements exchanged", "element", _exchange_words("galerkin", "pw")),
    Mutation(
        "composite triangle for the new one",
        "element",
        _replace_patterns((r"\bpw-T6", "composite-T6")),
    ),
    Mutation(
        "native quadrilateral for the pair", "element", _replace_patterns((r"\bpw-Q8", "pw-Q9"))
    ),
    Mutation(
        "new element's matrices symmetrised",
        "law",
        _replace_patterns(
            (r"^(7\.[56])/pw-", r"\1/pwsym-"),
            (r"^I/factors-pw-", "I/factors-galerkin-"),
            (r"^pw_(?=\w+_unsymmetry)", "galerkin_"),
            (r"(?<=unsymmetry_)pw$", "galerkin"),
        ),
    ),
    Mutation(
        "consistent mass lumped",
        "law",
        _replace_patterns((r"^(7\.5/pw(sym)?-[TQ]\d(-same)?)$", r"\1-lumped")),
    ),
    Mutation("geometric stiffnesses G and J exchanged", "law", _exchange_forms),
    Mutation(
        "friction left out",
        "law",
        _replace_patterns((r"^(7\.[34]/[\w-]+[TQ]\d|I/factors-[\w-]+T6)$", r"\1-mu0")),
    ),
    Mutation("tension and compression exchanged", "sign", sign_pattern=r"force_|smallest_"),
    Mutation("sign of the geometric stiffness", "sign", sign_pattern=r"sigma_cr"),
)
ROW_MUTATIONS = tuple(
    Mutation(f"{table}: {one} and {other} exchanged", "row", table=table, rows=(one, other))
    for table, one, other in (
        ("Table 1", "CAX6", "6-node user element"),
        ("Table 1", "CAX8", "8-node user element"),
        ("Table 1", "CAX6", "CAX8"),
        ("Table 2", "CPS6", "6-node user element"),
        ("Table 2", "CPS6", "CPS6M"),
    )
)
MISPRINT_MUTATIONS = tuple(
    Mutation(f"{table}: {row}, mode {mode + 1}", "print", table=table, rows=(row,), mode_index=mode)
    for table, rows in PRINTED_TABLES.items()
    for row, numbers in rows.items()
    for mode in range(len(numbers))
)
OWN_NUMBER_PREFIX = "printed number "  # prefix of names of misprints of statements' own numbers


def load_facts(path: Path = FACTS_FILE) -> list[Fact]:
    """Read the facts from a TOML file."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))["fact"]
    return [Fact(**{**table, "statements": tuple(table["statements"])}) for table in tables]


def write_claims_with_facts(out: Path, verdicts: list[Verdict], results: Results) -> None:
    """Write `<out>/claims.json`, including the facts on which the paper's statements rest."""
    turning_mutations = find_turning_mutations(verdicts, results)
    facts = assign_facts([verdict.claim for verdict in verdicts], turning_mutations, load_facts())
    claims.write_claims(out, verdicts, facts, turning_mutations)


def find_turning_mutations(verdicts: list[Verdict], results: Results) -> dict[str, tuple[str, ...]]:
    """Return, by id of the claim, the names of the mutations that reverse each claim.

    To statements of the paper, all mutations are applied. To findings, only mutations of the
    printed tables are.
    """
    judged_verdicts = [
        judged_verdict
        for judged_verdict in verdicts
        if judged_verdict.claim.judgement and judged_verdict.measured is not None
    ]
    paper_verdicts = [v for v in judged_verdicts if v.claim.kind in PAPER_KINDS]
    turning_mutations: dict[str, list[str]] = {v.claim.id: [] for v in judged_verdicts}
    for mutation in RESULT_MUTATIONS:
        for claim_id in _find_changed_claims(paper_verdicts, _MutatedResults(results, mutation)):
            turning_mutations[claim_id].append(mutation.name)
    for table, rows in PRINTED_TABLES.items():
        table_readers = _verdicts_that_read(judged_verdicts, results, table, rows)
        row_readers = {
            row: _verdicts_that_read(table_readers, results, table, [row]) for row in rows
        }
        for mutation in (
            candidate
            for candidate in (*ROW_MUTATIONS, *MISPRINT_MUTATIONS)
            if candidate.table == table
        ):
            affected_verdicts = [
                v for v in judged_verdicts if any(v in row_readers[row] for row in mutation.rows)
            ]
            changed_ids: set[str] = set()
            for misprinted_rows in _list_misprinted_rows(mutation):
                with _replace_rows(table, misprinted_rows):
                    changed_ids.update(_find_changed_claims(affected_verdicts, results))
            for claim_id in changed_ids:
                turning_mutations[claim_id].append(mutation.name)
    for verdict in paper_verdicts:
        if verdict.claim.printed and _depends_on_own_number(verdict, results):
            turning_mutations[verdict.claim.id].append(own_number_mutation(verdict.claim))
    return {name: tuple(found) for name, found in turning_mutations.items()}


def assign_facts(
    statements: list[Claim], turning_mutations: Mapping[str, tuple[str, ...]], facts: list[Fact]
) -> dict[str, str]:
    """Return, by id of the statement, the fact on which each statement of the paper rests.

    Statements share a fact if the same exchanges of elements, laws, signs and rows reverse them.
    Misprints count only for statements that no mutation of stored results reverses. Definitions,
    and statements that nothing reverses, are listed in the fact itself. Statements without a fact
    are omitted.
    """
    stated_facts = {claim_id: fact.id for fact in facts for claim_id in fact.statements}
    paper_claims = [claim for claim in statements if claim.kind in PAPER_KINDS]
    mutations_by_claim = {
        claim.id: fact_mutations(claim, turning_mutations.get(claim.id, ()))
        for claim in paper_claims
    }
    facts_by_mutations = {
        mutations_by_claim[name]: fact
        for name, fact in stated_facts.items()
        if mutations_by_claim.get(name)
    }
    assigned_facts = {
        name: facts_by_mutations.get(mutations) if mutations else stated_facts.get(name)
        for name, mutations in mutations_by_claim.items()
    }
    return {name: fact for name, fact in assigned_facts.items() if fact}


def fact_mutations(claim: Claim, turning_mutations: Sequence[str]) -> frozenset[str]:
    """Return the mutations that identify the fact of a statement; definitions have none."""
    if claim.basis == "definition":
        return frozenset()
    result_mutations = {mutation.name for mutation in RESULT_MUTATIONS}
    misprints = {name for name in turning_mutations if name.startswith(OWN_NUMBER_PREFIX)} | {
        mutation.name for mutation in MISPRINT_MUTATIONS
    }
    return frozenset(turning_mutations) - (
        misprints if result_mutations & {*turning_mutations} else set()
    )


def own_number_mutation(claim: Claim) -> str:
    """Return the name of the mutation that misprints the number in a statement."""
    judgement = claim.judgement
    assert judgement is not None
    return f"{OWN_NUMBER_PREFIX}{judgement.value:g}{judgement.unit and ' '}{judgement.unit}"


class _MutatedResults(Results):
    """Stored results in which each case is replaced by its mutated counterpart, if that exists."""

    def __init__(self, results: Results, mutation: Mutation) -> None:
        super().__init__(results.folder)
        self._results, self._mutation = results, mutation

    def __getitem__(self, key: str) -> StoredResult:
        stored_results, mutated_key = [self._results[key]], self._mutation.rename_stored(key)
        if mutated_key != key:
            with suppress(MissingResult, CorruptResult):
                stored_results.append(self._results[mutated_key])
        scalars = {
            name: value for stored in stored_results for name, value in stored.scalars.items()
        }

        def unpack_curves() -> dict[str, Any]:
            return self._flip_signs(
                {name: curve for stored in stored_results for name, curve in stored.curves.items()}
            )

        return replace(
            stored_results[0], scalars=self._mutate_scalars(scalars), unpack=unpack_curves
        )

    def section(self, section: str) -> list[Any]:
        """Return the results of a section, which are read only when a measure uses them."""
        return [_LazyResult(self, stored) for stored in self._results.section(section)]

    def _mutate_scalars(self, scalars: Mapping[str, float]) -> dict[str, float]:
        mutated_names = {name: self._mutation.rename_stored(name) for name in scalars}
        return self._flip_signs(
            {name: scalars.get(mutated_names[name], scalars[name]) for name in scalars}
        )

    def _flip_signs(self, values: Mapping[str, Any]) -> dict[str, Any]:
        sign_pattern = self._mutation.sign_pattern
        return {
            name: -value if sign_pattern and re.match(sign_pattern, name) else value
            for name, value in values.items()
        }


class _LazyResult:
    """Stored result that is read when its scalars or curves are first used."""

    has = StoredResult.has

    def __init__(self, results: Results, stored: StoredResult) -> None:
        self._results = results
        self.key, self.section, self.case = stored.key, stored.section, stored.case
        self.parameters = stored.parameters

    def __getattr__(self, name: str) -> object:
        return getattr(self._results[self.key], name)


def _find_changed_claims(verdicts: list[Verdict], results: Results) -> list[str]:
    """Return the ids of the claims whose verdict or pinned number changes with other results.

    Claims for which these results lack a number are omitted.
    """

    def has_changed(old_verdict: Verdict) -> bool:
        try:
            (new_verdict,) = judge([old_verdict.claim], results)
        except StudyError:
            return False
        changed = (new_verdict.verdict, new_verdict.differs) != (
            old_verdict.verdict,
            old_verdict.differs,
        )
        return changed and new_verdict.measured is not None

    return [verdict.claim.id for verdict in verdicts if has_changed(verdict)]


@contextmanager
def _replace_rows(table: str, rows: TableRows) -> Iterator[None]:
    original_rows = dict(PRINTED_TABLES[table])
    try:
        PRINTED_TABLES[table].update(rows)
        yield
    finally:
        PRINTED_TABLES[table].update(original_rows)


def _list_misprinted_rows(mutation: Mutation) -> list[TableRows]:
    table, mode = PRINTED_TABLES[mutation.table], mutation.mode_index
    if mutation.kind == "row":
        first_row, second_row = mutation.rows
        return [{first_row: table[second_row], second_row: table[first_row]}]
    (row,) = mutation.rows
    return [
        {row: (*table[row][:mode], misread_number, *table[row][mode + 1 :])}
        for misread_number in misread_digits(table[row][mode])
    ]


def misread_digits(number: float) -> tuple[float, float]:
    """Return a number decreased and increased by one unit of its second (or only) digit."""
    digits = f"{number:.15g}".replace(".", "").strip("0").partition("e")[0]
    power = int(f"{number:e}".partition("e")[2])
    digit_step = 10.0 ** (power - (len(digits) > 1))
    return number - digit_step, number + digit_step


def _verdicts_that_read(
    verdicts: list[Verdict], results: Results, table: str, rows: Iterable[str]
) -> list[Verdict]:
    """Return the verdicts whose measured numbers depend on the given rows of a printed table."""
    altered_rows = {
        row: tuple(
            (1.3 + 0.1 * mode_index + 0.07 * row_index) * number
            for mode_index, number in enumerate(PRINTED_TABLES[table][row])
        )
        for row_index, row in enumerate(rows)
    }
    with _replace_rows(table, altered_rows):
        altered_verdicts = judge([v.claim for v in verdicts], results)
    return [
        verdict
        for verdict, altered_verdict in zip(verdicts, altered_verdicts, strict=True)
        if verdict.measured != altered_verdict.measured
    ]


def _depends_on_own_number(verdict: Verdict, results: Results) -> bool:
    judgement = verdict.claim.judgement
    assert judgement is not None
    misread_claims = [
        replace(verdict.claim, judgement=replace(judgement, value=misread_value))
        for misread_value in misread_digits(judgement.value)
    ]
    return any(
        misread_verdict.verdict != verdict.verdict
        for misread_verdict in judge(misread_claims, results)
    )
