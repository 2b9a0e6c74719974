"""Recompute recorded numbers, and write the records or compare with them.

./run python3 -m study.publish.renew_records                     compute all; write the records
./run python3 -m study.publish.renew_records V13/cube-pw-16      this row only
./run python3 -m study.publish.renew_records 'calculix/*' 'K/*'  all rows of CalculiX and section K
./run python3 -m study.publish.renew_records --check             compute all; compare

Keys of rows may contain shell wildcards. The kinds of rows are costly cases, time and memory of
section K, results of CalculiX ('calculix/*'), columns and shifts of Table 1 ('table-1-columns/*',
'table-1-shifts/*') and models of Table 2 ('table-2/*'); see `study.run.records`. If CalculiX is not
installed, its rows are skipped; if only its rows are requested, Python and NumPy suffice. Rows
'K/peer-*' need the other programs named in `study.benchmarks.k_cost.measure`. When
measurements of time and memory are compared, only counts and norms must agree.
"""

import argparse
import sys
import tempfile
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from importlib import import_module
from pathlib import Path
from time import perf_counter, process_time
from types import ModuleType

from study.run import compare_versions, records
from study.run.cases import SECTIONS, Case, load_section
from study.run.records import RecordRow
from study.run.store import Results, StudyError, save
from study.solutions.calculix import calculix
from study.solutions.calculix.output import CalculixError
from study.solutions.calculix.problems import PROBLEMS

# Pages, section K and tables import the solver; they are imported when their rows are requested


class RecordKind(ABC):
    """A kind of recorded results, whose rows are stored in one file and computed in the same way.

    Attributes:
        title: Name of the kind in messages.
        prefix: Beginning of the keys of all rows; empty for costly cases, whose keys begin with
            sections.
    """

    title: str
    prefix: str

    @property
    @abstractmethod
    def path(self) -> Path:
        """File that contains the rows of this kind."""

    def may_have_key(self, pattern: str) -> bool:
        """Return whether keys of this kind may match a shell-style pattern."""
        return pattern.startswith(self.prefix)

    @abstractmethod
    def list_keys(self) -> list[str]:
        """Return the keys of all rows that the file should contain, in the order of the file."""

    @abstractmethod
    def compute(self, key: str) -> RecordRow:
        """Compute the row with the given key."""

    def compare_rows(
        self, recorded: dict[str, RecordRow], computed: dict[str, RecordRow]
    ) -> list[str]:
        """Print differences between recorded and computed rows; return messages on excessive ones.

        By default, scalars are compared with the tolerances for two versions of DOLFINx. Of
        measured rows, only counts and norms are compared, not times and memory.

        Args:
            recorded: Rows from the file, by key.
            computed: Recomputed rows, by key.

        Returns:
            Error messages; empty if no difference is too large.
        """
        return _print_and_check_scalar_differences(recorded, computed)

    def find_missing_program(self, key: str) -> str:  # noqa: ARG002
        """Return which program must be installed to compute a row; empty if none is missing."""
        return ""

    def is_worth_recording(self, row: RecordRow) -> bool:  # noqa: ARG002
        """Return whether a row is written to the file, e.g. because its computation takes long."""
        return True


class CostlyCaseRecords(RecordKind):
    """Records of the cases of all sections that are marked as costly."""

    title = "costly cases"
    prefix = ""

    def __init__(self) -> None:
        self._cases_by_key: dict[str, Case] = {}

    @property
    def path(self) -> Path:
        """File that contains the rows of this kind."""
        return records.COSTLY_CASES

    def may_have_key(self, pattern: str) -> bool:
        """Return whether a key or pattern belongs to none of the other kinds."""
        return not any(
            kind.may_have_key(pattern)
            for kind in list_record_kinds()
            if not isinstance(kind, CostlyCaseRecords)
        )

    def list_keys(self) -> list[str]:
        """Return the keys of the costly cases of all sections."""
        self._cases_by_key = find_costly_cases()
        return list(self._cases_by_key)

    def compute(self, key: str) -> RecordRow:
        """Run the costly case with the given key; return its row."""
        case = self._cases_by_key[key]
        start = process_time()
        result = case.run(**case.parameters)
        content = {
            "parameters": case.stored_parameters,
            "scalars": {name: float(f"{value:.12g}") for name, value in result.scalars.items()},
            "units": {name: unit for name, unit in result.units.items() if unit != "1"},
            "dofs": result.dofs,
            "seconds": round(process_time() - start, 1),
        }
        return records.create_row_with_current_date(
            key, records.digest_input(case.stored_parameters), content
        )

    def is_worth_recording(self, row: RecordRow) -> bool:
        """Return whether the recorded CPU time of a case exceeds the limit for recording."""
        return records.takes_long_enough_to_record(row)


class TimeAndMemoryRecords(RecordKind):
    """Records of the computing times and memory that section K measures."""

    title = "time and memory of section K"
    prefix = "K/"

    @property
    def path(self) -> Path:
        """File that contains the rows of this kind."""
        return records.TIME_AND_MEMORY

    def list_keys(self) -> list[str]:
        """Return the keys of all measurements of section K."""
        from study.benchmarks.k_cost.measure import list_measurements

        return [measurement.key for measurement in list_measurements()]

    def compute(self, key: str) -> RecordRow:
        """Measure time and memory for the problem with the given key; return the row."""
        from study.benchmarks.k_cost.measure import list_measurements, measure_and_make_record_row

        (measurement,) = (candidate for candidate in list_measurements() if candidate.key == key)
        return measure_and_make_record_row(measurement)

    def find_missing_program(self, key: str) -> str:
        """Return which program must be installed to measure a row; empty if none is missing."""
        from study.benchmarks.k_cost.measure import find_missing_peer, list_measurements

        (measurement,) = (candidate for candidate in list_measurements() if candidate.key == key)
        return find_missing_peer(measurement)


class CalculixResultRecords(RecordKind):
    """Records of the results that CalculiX computes for the comparison problems."""

    title = "answers of CalculiX"
    prefix = "calculix/"

    @property
    def path(self) -> Path:
        """File that contains the rows of this kind."""
        return records.CALCULIX

    def list_keys(self) -> list[str]:
        """Return the keys of all problems for CalculiX."""
        return [calculix.record_row_key(name) for name in PROBLEMS]

    def compute(self, key: str) -> RecordRow:
        """Run CalculiX for the problem with the given key; return the row of its results.

        Raises:
            CalculixError: If CalculiX is not installed or fails.
        """
        name, program = key.partition("/")[2], calculix.find_calculix()
        if program is None:
            raise CalculixError(calculix.MISSING)
        return calculix.make_record_row(name, calculix.run_calculix_on_problem(name, program))

    def find_missing_program(self, key: str) -> str:  # noqa: ARG002
        """Return a message if CalculiX, which computes all rows of this kind, is not installed."""
        return "" if calculix.find_calculix() else calculix.MISSING

    def compare_rows(
        self, recorded: dict[str, RecordRow], computed: dict[str, RecordRow]
    ) -> list[str]:
        """Compare recorded and computed results of CalculiX; return messages on rows that differ.

        A row differs if the digests of the input decks differ, or if the largest difference of the
        numbers exceeds the tolerance for CalculiX. The largest difference of all rows is printed.
        """

        def difference_of_rows(row: RecordRow, recorded_row: RecordRow) -> float:
            return calculix.largest_relative_difference(
                calculix.result_from_record_row(row), calculix.result_from_record_row(recorded_row)
            )

        return _compare_inputs_and_numbers(
            self.title, recorded, computed, difference_of_rows, calculix.TOLERANCE
        )


class TableRecords(RecordKind):
    """Records of a table's columns, shifts or models, which a module computes and compares.

    Args:
        title: Name of the kind in messages.
        prefix: Beginning of the keys of all rows.
        path: File that contains the rows.
        module_name: Full name of the module, which has `list_keys`, `compute_row`,
            `difference_of_rows` and `RECORD_TOLERANCE`.
    """

    def __init__(self, title: str, prefix: str, path: Path, module_name: str) -> None:
        self.title = title
        self.prefix = prefix
        self._path = path
        self.module_name = module_name

    @property
    def path(self) -> Path:
        """File that contains the rows of this kind."""
        return self._path

    def list_keys(self) -> list[str]:
        """Return the keys of all rows; those of shifts depend on the recorded columns."""
        return list(self._module.list_keys())

    def compute(self, key: str) -> RecordRow:
        """Compute the row with the given key."""
        row: RecordRow = self._module.compute_row(key)
        return row

    def compare_rows(
        self, recorded: dict[str, RecordRow], computed: dict[str, RecordRow]
    ) -> list[str]:
        """Compare recorded and computed rows; return messages on rows that differ.

        A row differs if the digests of the inputs differ, or if the largest difference of the
        numbers, in last digits, exceeds the module's tolerance. The largest difference of all rows
        is printed.
        """
        return _compare_inputs_and_numbers(
            f"{self.title}, in last digits",
            recorded,
            computed,
            self._module.difference_of_rows,
            self._module.RECORD_TOLERANCE,
        )

    @property
    def _module(self) -> ModuleType:
        return import_module(self.module_name)


def list_record_kinds() -> list[RecordKind]:
    """Return all kinds of records; shifts of Table 1 follow the columns, on which they depend."""
    tables = [
        ("columns of Table 1", "table-1-columns/", records.TABLE_1_COLUMNS, "table_1.ensemble"),
        ("shifts of Table 1", "table-1-shifts/", records.TABLE_1_SHIFTS, "table_1.family"),
        ("models of Table 2", "table-2/", records.TABLE_2, "table_2.family"),
    ]
    return [
        CalculixResultRecords(),
        CostlyCaseRecords(),
        TimeAndMemoryRecords(),
        *(
            TableRecords(title, prefix, path, f"study.paper.{module}")
            for title, prefix, path, module in tables
        ),
    ]


def main(arguments: list[str] | None = None) -> int:
    """Recompute records, and write them or compare them with the existing files.

    Args:
        arguments: Command-line arguments; by default, those of this process.

    Returns:
        Exit status: 1 if numbers differ, CalculiX fails, or all requested rows are skipped;
        otherwise 0.
    """
    parser = argparse.ArgumentParser(
        prog="study.publish.renew_records",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("keys", nargs="*", metavar="KEY", help="as V13/cube-pw-16 or 'calculix/*'")
    parser.add_argument("--check", action="store_true", help="compare with the records")
    options = parser.parse_args(arguments)
    messages: list[str] = []
    n_computed, n_skipped = 0, 0
    for kind in list_record_kinds():
        patterns = [pattern for pattern in options.keys if kind.may_have_key(pattern)]
        if options.keys and not patterns:
            continue
        all_keys = kind.list_keys()
        try:
            keys = select_keys(all_keys, patterns)
        except StudyError as error:
            parser.error(f"there are no {kind.title} {error}")
        missing_programs = {key: kind.find_missing_program(key) for key in keys}
        computable_keys = [key for key in keys if not missing_programs[key]]
        n_skipped += len(keys) - len(computable_keys)
        for reason, n_rows in Counter(filter(None, missing_programs.values())).items():
            print(
                f"SKIPPED: {n_rows} rows of {kind.title}: {reason}",
                file=sys.stderr,
                flush=True,
            )
        computed, failures = _compute_and_write_rows(
            kind, computable_keys, all_keys, write=not options.check
        )
        n_computed += len(computed)
        messages += failures
        if options.check and computed:
            messages += kind.compare_rows(records.read_rows(kind.path), computed)
    for message in messages:
        print(f"renew_records: {message}", file=sys.stderr)
    return int(bool(messages) or (n_skipped > 0 and n_computed == 0))


def select_keys(keys: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """Return the keys that match a pattern, or all keys if there are no patterns.

    Raises:
        StudyError: If a pattern matches no key.
    """
    for pattern in patterns:
        if not any(fnmatchcase(key, pattern) for key in keys):
            raise StudyError(f"{pattern}, but {', '.join(keys)}")
    return [
        key
        for key in keys
        if not patterns or any(fnmatchcase(key, pattern) for pattern in patterns)
    ]


def find_costly_cases() -> dict[str, Case]:
    """Return the costly cases of all sections, by key."""
    cases = [case for section in SECTIONS for case in load_section(section).cases]
    recomputed_cases = [case.computing_case or case for case in cases]
    return {case.key: case for case in recomputed_cases if case.costly}


def _compute_and_write_rows(
    kind: RecordKind, keys: Sequence[str], all_keys: Sequence[str], write: bool
) -> tuple[dict[str, RecordRow], list[str]]:
    """Compute rows of one kind, and write the file after each row if `write` is true.

    Args:
        kind: Kind of the rows.
        keys: Keys of the rows to be computed.
        all_keys: Keys of all rows of this kind, in the order of the file.
        write: Whether to write the file; rows that are not computed are kept.

    Returns:
        Computed rows by key, and the error messages of CalculiX.
    """
    rows, computed, failures = dict(records.read_rows(kind.path)), {}, []
    for key in keys:
        start = perf_counter()
        try:
            rows[key] = computed[key] = kind.compute(key)
        except CalculixError as error:
            failures.append(str(error))
            continue
        print(f"{key}: {perf_counter() - start:.1f} s", file=sys.stderr, flush=True)
        if write:
            present_rows = [rows[row_key] for row_key in all_keys if row_key in rows]
            records.write_rows(
                kind.path, [row for row in present_rows if kind.is_worth_recording(row)]
            )
    return computed, failures


def _compare_inputs_and_numbers(
    title: str,
    recorded: dict[str, RecordRow],
    computed: dict[str, RecordRow],
    difference_of_rows: Callable[[RecordRow, RecordRow], float],
    tolerance: float,
) -> list[str]:
    """Print the largest difference of rows; return messages on rows that differ.

    Args:
        title: Name of the kind of rows, and the unit of the differences.
        recorded: Rows from the file, by key.
        computed: Recomputed rows, by key.
        difference_of_rows: Largest difference of the numbers of a computed and a recorded row.
        tolerance: Largest accepted difference.

    Returns:
        Messages on rows without a record, with another digest of the input, or with an excessive
        difference.
    """
    messages, max_difference = [], 0.0
    for key, row in computed.items():
        if key not in recorded:
            messages.append(f"{key}: not in the record")
            continue
        if row.input_sha256 != recorded[key].input_sha256:
            messages.append(f"{key}: the input is not the one of the record")
            continue
        difference = difference_of_rows(row, recorded[key])
        max_difference = max(max_difference, difference)
        if difference > tolerance:
            versions = f"{_join_versions(row)}; recorded with {_join_versions(recorded[key])}"
            messages.append(f"{key}: differs by {difference:.1e} ({versions})")
    print(
        f"{title}: {len(computed)}, largest difference {max_difference:.1e} "
        f"(at most {tolerance:.0e})"
    )
    return messages


def _join_versions(row: RecordRow) -> str:
    return ", ".join(f"{name} {version}" for name, version in row.versions.items())


def _print_and_check_scalar_differences(
    recorded: dict[str, RecordRow], computed: dict[str, RecordRow]
) -> list[str]:
    """Print the largest difference between recorded and computed scalars, for each kind of scalar.

    Returns:
        A message with the number of excessive differences; empty if there are none.
    """
    kinds = (
        compare_versions.COUNTS_AND_TIMES,
        *compare_versions.RECORD_KINDS,
        *compare_versions.KINDS,
    )
    with tempfile.TemporaryDirectory() as folder:
        old_folder, new_folder = Path(folder, "recorded"), Path(folder, "computed")
        for path, rows in ((old_folder, recorded), (new_folder, computed)):
            for key in computed.keys() & rows.keys():
                section, _, case = key.partition("/")
                content = rows[key].content
                scalars = content.get("scalars") or content["measured"]
                result = records.recorded(scalars, content.get("units", {}), 0)
                save(path, section, case, result, {"key": key}, {})
        differences, unpaired = compare_versions.compare_scalars_of_folders(
            Results(old_folder), Results(new_folder), kinds
        )
    print(compare_versions.format_differences(differences, unpaired, kinds))
    n_different = len(unpaired) + sum(difference.too_large for difference in differences)
    return [f"{n_different} numbers differ from the record, see above"] if n_different else []


if __name__ == "__main__":
    sys.exit(main())
