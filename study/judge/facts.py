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
from study.judge.claims import PAPER_KINDS, Claim, Verdict, judge_claims
from study.paper.items import TABLE_1, TABLE_2
from study.run.store import CorruptResult, MissingResult, Results, StoredResult, StudyError

FACTS_FILE = Path(__file__).parent / "facts.toml"
TableRows: TypeAlias = dict[str, tuple[float, ...]]
PRINTED_TABLES: dict[str, TableRows] = {"Table 1": TABLE_1, "Table 2": TABLE_2}
MutationKind = Literal["element", "law", "sign", "row", "print"]


@dataclass(frozen=True)
class Fact:
    """Independent fact on which one or more statements of the paper rest.

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
        replace_stored_name: Function that replaces the key of a case or the name of a scalar by
            that of the case or scalar to be used instead.
        sign_pattern: Regular expression for names of scalars and curves whose signs are reversed.
        table: Name of the table in `PRINTED_TABLES` that is altered.
        rows: Two rows of the table to exchange, or one row with a misprint.
        mode_index: Position of the misprint in its row.
    """

    name: str
    kind: MutationKind
    replace_stored_name: Callable[[str], str] = lambda name: name
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
    """Return a function that applies pairs (regular expression, replacement) to a text in order."""

    def replace_all(text: str) -> str:
        for pattern, replacement in pairs:
            text = re.sub(pattern, replacement, text)
        return text

    return replace_all


_BUCKLING_CASE_PATTERN = r"^(7\.6/[a-z]+-[TQ]\d)"


def _exchange_geometric_stiffnesses_in_name(name: str) -> str:
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
    Mutation(
        "geometric stiffnesses G and J exchanged", "law", _exchange_geometric_stiffnesses_in_name
    ),
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
    reversing_mutations = find_mutations_that_reverse_verdicts(verdicts, results)
    facts = assign_facts_to_paper_statements(
        [verdict.claim for verdict in verdicts], reversing_mutations, load_facts()
    )
    claims.write_claims(out, verdicts, facts, reversing_mutations)


def find_mutations_that_reverse_verdicts(
    verdicts: list[Verdict], results: Results
) -> dict[str, tuple[str, ...]]:
    """Return the names of the mutations that reverse each verdict, by id of the claim.

    All mutations are applied for statements of the paper. For findings and pins, only mutations of
    the printed tables are applied.
    """
    judged_verdicts = [
        judged_verdict
        for judged_verdict in verdicts
        if judged_verdict.claim.judgement and judged_verdict.measured is not None
    ]
    paper_verdicts = [v for v in judged_verdicts if v.claim.kind in PAPER_KINDS]
    reversing_mutations: dict[str, list[str]] = {v.claim.id: [] for v in judged_verdicts}
    for mutation in RESULT_MUTATIONS:
        for claim_id in _ids_of_claims_with_changed_verdict(
            paper_verdicts, _MutatedResults(results, mutation)
        ):
            reversing_mutations[claim_id].append(mutation.name)
    for table, rows in PRINTED_TABLES.items():
        verdicts_on_table = _verdicts_that_depend_on_table_rows(
            judged_verdicts, results, table, rows
        )
        verdicts_by_row = {
            row: _verdicts_that_depend_on_table_rows(verdicts_on_table, results, table, [row])
            for row in rows
        }
        for mutation in (
            candidate
            for candidate in (*ROW_MUTATIONS, *MISPRINT_MUTATIONS)
            if candidate.table == table
        ):
            affected_verdicts = [
                v
                for v in judged_verdicts
                if any(v in verdicts_by_row[row] for row in mutation.rows)
            ]
            changed_ids: set[str] = set()
            for misprinted_rows in _list_altered_table_rows(mutation):
                with _temporarily_replace_table_rows(table, misprinted_rows):
                    changed_ids.update(
                        _ids_of_claims_with_changed_verdict(affected_verdicts, results)
                    )
            for claim_id in changed_ids:
                reversing_mutations[claim_id].append(mutation.name)
    for verdict in paper_verdicts:
        if verdict.claim.printed and _own_number_misprint_reverses_verdict(verdict, results):
            reversing_mutations[verdict.claim.id].append(name_of_own_number_misprint(verdict.claim))
    return {name: tuple(found) for name, found in reversing_mutations.items()}


def assign_facts_to_paper_statements(
    statements: list[Claim], reversing_mutations: Mapping[str, tuple[str, ...]], facts: list[Fact]
) -> dict[str, str]:
    """Return the id of the fact on which each statement of the paper rests, by id of the statement.

    Statements share a fact if the same exchanges of elements, laws, signs and rows reverse them.
    Misprints count only for statements that no mutation of stored results reverses. For definitions
    and for statements that no mutation reverses, the fact itself lists the ids of the statements.
    Statements without a fact are omitted.
    """
    stated_facts = {claim_id: fact.id for fact in facts for claim_id in fact.statements}
    paper_claims = [claim for claim in statements if claim.kind in PAPER_KINDS]
    mutations_by_claim = {
        claim.id: mutations_that_identify_fact(claim, reversing_mutations.get(claim.id, ()))
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


def mutations_that_identify_fact(
    claim: Claim, reversing_mutations: Sequence[str]
) -> frozenset[str]:
    """Return the mutations by which the fact of a statement is identified; definitions have none.

    Misprints are omitted if a mutation of stored results reverses the statement, too.

    Args:
        claim: Statement of the paper.
        reversing_mutations: Names of all mutations that reverse the statement.
    """
    if claim.basis == "definition":
        return frozenset()
    result_mutations = {mutation.name for mutation in RESULT_MUTATIONS}
    misprints = {name for name in reversing_mutations if name.startswith(OWN_NUMBER_PREFIX)} | {
        mutation.name for mutation in MISPRINT_MUTATIONS
    }
    return frozenset(reversing_mutations) - (
        misprints if result_mutations & {*reversing_mutations} else set()
    )


def name_of_own_number_misprint(claim: Claim) -> str:
    """Return the name of the mutation that misprints the number which a statement quotes."""
    judgement = claim.judgement
    assert judgement is not None
    return f"{OWN_NUMBER_PREFIX}{judgement.value:g}{judgement.unit and ' '}{judgement.unit}"


class _MutatedResults(Results):
    """Stored results in which each case is replaced by its mutated counterpart, if that exists."""

    def __init__(self, results: Results, mutation: Mutation) -> None:
        super().__init__(results.folder)
        self._results, self._mutation = results, mutation

    def __getitem__(self, key: str) -> StoredResult:
        stored_results, mutated_key = [self._results[key]], self._mutation.replace_stored_name(key)
        if mutated_key != key:
            with suppress(MissingResult, CorruptResult):
                stored_results.append(self._results[mutated_key])
        scalars = {
            name: value for stored in stored_results for name, value in stored.scalars.items()
        }

        def unpack_curves() -> dict[str, Any]:
            return self._flip_signs_of_matching_names(
                {name: curve for stored in stored_results for name, curve in stored.curves.items()}
            )

        return replace(
            stored_results[0],
            scalars=self._exchange_scalars_and_flip_signs(scalars),
            unpack=unpack_curves,
        )

    def section(self, section: str) -> list[Any]:
        """Return all results of a section; each is read when a measure first uses it."""
        return [_LazyResult(self, stored) for stored in self._results.section(section)]

    def _exchange_scalars_and_flip_signs(self, scalars: Mapping[str, float]) -> dict[str, float]:
        mutated_names = {name: self._mutation.replace_stored_name(name) for name in scalars}
        return self._flip_signs_of_matching_names(
            {name: scalars.get(mutated_names[name], scalars[name]) for name in scalars}
        )

    def _flip_signs_of_matching_names(self, values: Mapping[str, Any]) -> dict[str, Any]:
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


def _ids_of_claims_with_changed_verdict(verdicts: list[Verdict], results: Results) -> list[str]:
    """Return the ids of the claims whose verdict changes if other results are used.

    Claims also count if their number begins or ceases to differ from the expected one.

    Claims that cannot be judged from these results are omitted.

    Args:
        verdicts: Verdicts from the unchanged results.
        results: Mutated results.
    """

    def verdict_has_changed(old_verdict: Verdict) -> bool:
        try:
            (new_verdict,) = judge_claims([old_verdict.claim], results)
        except StudyError:
            return False
        changed = (new_verdict.verdict, new_verdict.differs) != (
            old_verdict.verdict,
            old_verdict.differs,
        )
        return changed and new_verdict.measured is not None

    return [verdict.claim.id for verdict in verdicts if verdict_has_changed(verdict)]


@contextmanager
def _temporarily_replace_table_rows(table: str, rows: TableRows) -> Iterator[None]:
    original_rows = dict(PRINTED_TABLES[table])
    try:
        PRINTED_TABLES[table].update(rows)
        yield
    finally:
        PRINTED_TABLES[table].update(original_rows)


def _list_altered_table_rows(mutation: Mutation) -> list[TableRows]:
    table, mode = PRINTED_TABLES[mutation.table], mutation.mode_index
    if mutation.kind == "row":
        first_row, second_row = mutation.rows
        return [{first_row: table[second_row], second_row: table[first_row]}]
    (row,) = mutation.rows
    return [
        {row: (*table[row][:mode], misprinted_number, *table[row][mode + 1 :])}
        for misprinted_number in misprints_of_second_digit(table[row][mode])
    ]


def misprints_of_second_digit(number: float) -> tuple[float, float]:
    """Return a number decreased and increased by one unit of its second (or only) digit."""
    digits = f"{number:.15g}".replace(".", "").strip("0").partition("e")[0]
    power = int(f"{number:e}".partition("e")[2])
    digit_step = 10.0 ** (power - (len(digits) > 1))
    return number - digit_step, number + digit_step


def _verdicts_that_depend_on_table_rows(
    verdicts: list[Verdict], results: Results, table: str, rows: Iterable[str]
) -> list[Verdict]:
    """Return the verdicts whose measured numbers depend on the given rows of a printed table.

    The rows are multiplied by different factors, and the claims are judged again.
    """
    altered_rows = {
        row: tuple(
            (1.3 + 0.1 * mode_index + 0.07 * row_index) * number
            for mode_index, number in enumerate(PRINTED_TABLES[table][row])
        )
        for row_index, row in enumerate(rows)
    }
    with _temporarily_replace_table_rows(table, altered_rows):
        altered_verdicts = judge_claims([v.claim for v in verdicts], results)
    return [
        verdict
        for verdict, altered_verdict in zip(verdicts, altered_verdicts, strict=True)
        if verdict.measured != altered_verdict.measured
    ]


def _own_number_misprint_reverses_verdict(verdict: Verdict, results: Results) -> bool:
    judgement = verdict.claim.judgement
    assert judgement is not None
    misread_claims = [
        replace(verdict.claim, judgement=replace(judgement, value=misread_value))
        for misread_value in misprints_of_second_digit(judgement.value)
    ]
    return any(
        misread_verdict.verdict != verdict.verdict
        for misread_verdict in judge_claims(misread_claims, results)
    )
