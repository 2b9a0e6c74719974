"""Store and read the results of cases.

Numbers are stored in `<out>/<section>/<case>.json`, and arrays (curves) in `<case>.npz` beside it.

The project has its own store because `joblib.Memory`, which survives SIGKILL as well (of 1428
results none was bad, and 45 unfinished files were left), returns a result with a flipped byte
without an error, and a stale one if a function changes which the cached function calls. `diskcache`
returns a result with a flipped byte without an error, too.
"""

import hashlib
import io
import json
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from study.run import files

EXIT_CORRUPT = 3  # exit status of commands if stored results cannot be read

_FORMAT_NAME = "pw_elements study result"
FORMAT = f"{_FORMAT_NAME} 2"
_TABLES = ("parameters", "scalars", "units", "provenance")
_ENTRIES = {"format", "section", "case", *_TABLES, "digest"}
_ENTRIES_OF_FIRST_FORMAT = {"case", *_TABLES}  # the first format was not named


class StudyError(Exception):
    """Error that the user can correct; commands print its message without a traceback."""


class MissingResult(StudyError):
    """Error: a result has not been computed."""


class OutdatedResult(MissingResult):
    """Error: a stored result has the file format of another version of the study."""


class CorruptResult(StudyError):
    """Error: a stored file cannot be read, or was modified after it had been written."""


class MissingScalar(StudyError):
    """Error: a stored result has no scalar with the requested name."""


@dataclass(frozen=True)
class Result:
    """Result that the function of a case returns.

    Units are those of the problem: kN, kN/m² and m, or N, MPa and mm. For problems without units,
    the units are "unit force", "unit length" and "unit stress", which stand for any consistent
    units. Dimensionless quantities, ratios, counts and flags have the unit "1". Forces on a plane
    body are per unit thickness, and forces on an axisymmetric body are totals over the
    circumference.

    Attributes:
        scalars: Finite numbers by name.
        units: Unit of each scalar, by its name.
        curves: Arrays of any shape by name, such as values along a line; NaN marks a gap.
        dofs: Number of degrees of freedom of the discrete problem.
        processes: Number of MPI processes that took part.
    """

    scalars: Mapping[str, float]
    units: Mapping[str, str]
    curves: Mapping[str, np.ndarray] = field(default_factory=dict)
    dofs: int = 0
    processes: int = 1


@dataclass(frozen=True)
class StoredResult:
    """Result that was read from disk; its curves are decompressed on first use.

    Attributes:
        section: Name of the section.
        case: Name of the case.
        parameters: Parameters of the case, by name.
        scalars: Numbers by name.
        units: Unit of each scalar, by its name.
        unpack: Function that decompresses and returns the curves.
        provenance: Versions, times etc., see `study.run.provenance`.
    """

    section: str
    case: str
    parameters: dict[str, Any]
    scalars: dict[str, float]
    units: dict[str, str]
    unpack: Callable[[], dict[str, np.ndarray]]
    provenance: dict[str, Any]

    @cached_property
    def curves(self) -> dict[str, np.ndarray]:
        """Arrays by name, such as values along a line."""
        return self.unpack()

    @property
    def key(self) -> str:
        """Name of section and case, such as "7.1/pw-T6"."""
        return f"{self.section}/{self.case}"

    @property
    def record(self) -> str:
        """File in version control from which the result was read, relative to the project's folder.

        It is empty if the result was computed.
        """
        return str(self.provenance.get("record") or "")

    def has(self, /, **parameters: object) -> bool:
        """Return whether the result has the given parameters.

        Args:
            parameters: Value of each parameter, or a list of accepted values. A parameter that is
                itself a list, such as the divisions of a mesh, must equal the given list.
        """
        return all(
            name in self.parameters and _equals_or_is_among(self.parameters[name], value)
            for name, value in parameters.items()
        )


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file such that it is either complete or unchanged; create its folder if necessary."""
    path.parent.mkdir(parents=True, exist_ok=True)
    files.replace_file_atomically(path, data)


def remove_unfinished_files(out: Path) -> None:
    """Remove temporary files that killed processes have left in a folder and its subfolders."""
    for folder in (Path(out), *Path(out).glob("*/")):
        files.remove_files_of_killed_processes(folder)


def write_json(path: Path, content: object) -> None:
    """Write a JSON file atomically; NaN and infinity are errors."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    write_atomically(path, (text + "\n").encode())


def save(
    out: Path,
    section: str,
    case: str,
    result: Result,
    parameters: Mapping[str, Any],
    provenance: Mapping[str, Any],
) -> None:
    """Store the result of a case.

    The file contains a digest of its content, including the fingerprint of the case and the digest
    of the curves. Reading it therefore detects edited numbers, a file copied from another section,
    and a `.npz` file of another run, which a killed process may leave.

    Args:
        out: Folder of the results.
        section: Name of the section.
        case: Name of the case.
        result: The result.
        parameters: Parameters of the case, representable in JSON.
        provenance: Provenance, see `study.run.provenance.create_provenance`.

    Raises:
        StudyError: If there are no parameters, if a scalar is not finite or has no unit, or if a
            unit belongs to no scalar.
    """
    scalars = {name: float(value) for name, value in result.scalars.items()}
    units = dict(result.units)
    _check_parameters_scalars_and_units(f"{section}/{case}", parameters, scalars, units)
    folder = Path(out) / section
    curves = folder / f"{case}.npz"
    digest = None
    if result.curves:
        data = _pack_curves(result.curves)
        digest = hashlib.sha256(data).hexdigest()
        write_atomically(curves, data)
    content: dict[str, Any] = {
        "format": FORMAT,
        "section": section,
        "case": case,
        "parameters": dict(parameters),
        "scalars": scalars,
        "units": units,
        "provenance": {**provenance, "curves_sha256": digest},
    }
    content["digest"] = _digest_entries_except_digest(content)
    write_json(folder / f"{case}.json", content)  # last, because it completes the result
    if digest is None:
        files.remove_file_if_present(curves)


def discard_result(out: Path, section: str, case: str) -> None:
    """Remove a stored result if it exists."""
    for suffix in (".json", ".npz"):
        files.remove_file_if_present(Path(out) / section / f"{case}{suffix}")


def is_result_file(path: Path) -> bool:
    """Return whether a JSON file has the entries of a stored result of this or another version."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and (
        {*content} == _ENTRIES or _has_format_of_other_version(content)
    )


def _has_format_of_other_version(content: object) -> bool:
    if not isinstance(content, dict):
        return False
    is_other_format = (
        str(content.get("format")).startswith(f"{_FORMAT_NAME} ") and content["format"] != FORMAT
    )
    return is_other_format or {*content} == _ENTRIES_OF_FIRST_FORMAT


def _check_parameters_scalars_and_units(
    key: str,
    parameters: Mapping[str, Any],
    scalars: Mapping[str, float],
    units: Mapping[str, str],
) -> None:
    if not parameters:
        raise StudyError(f"{key} has no parameters")
    not_finite = [
        f"{name} = {value}" for name, value in scalars.items() if not math.isfinite(value)
    ]
    if not_finite:
        raise StudyError(f"{key} has numbers that are not finite: {', '.join(not_finite)}")
    without_unit = [name for name in scalars if not units.get(name)]
    if without_unit:
        raise StudyError(f"{key} has numbers without a unit: {', '.join(without_unit)}")
    superfluous = [name for name in units if name not in scalars]
    if superfluous:
        raise StudyError(f"{key} has units of no number: {', '.join(superfluous)}")


def _digest_entries_except_digest(content: Mapping[str, Any]) -> str:
    """Return the digest of all entries of a result file, except the entry "digest" itself."""
    entries = {name: part for name, part in content.items() if name != "digest"}
    text = json.dumps(entries, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _equals_or_is_among(stored: object, expected: object) -> bool:
    if isinstance(expected, list | tuple):
        return stored == list(expected) if isinstance(stored, list) else stored in expected
    return stored == expected


def _pack_curves(curves: Mapping[str, np.ndarray]) -> bytes:
    arrays = {name: np.asarray(curve) for name, curve in curves.items()}
    objects = [name for name, array in arrays.items() if array.dtype.hasobject]
    if objects:
        raise StudyError(f"curves that are not plain numbers: {', '.join(objects)}")
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]  # its stub allows only a flag
    return stream.getvalue()


class Results:
    """Results that are stored in a folder, read by keys such as "7.1/pw-T6".

    Results and lists of names are cached; create a new object to see later changes.

    Args:
        folder: Folder of the results.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self._stored: dict[str, StoredResult] = {}
        self._errors: dict[str, StudyError] = {}
        self._names: dict[str, list[str]] = {}

    def __contains__(self, key: str) -> bool:
        return self._path_of_result(key).is_file()

    def __getitem__(self, key: str) -> StoredResult:
        if key in self._errors:
            raise self._errors[key]
        if key not in self._stored:
            try:
                self._stored[key] = self._load(key)
            except StudyError as error:
                self._errors[key] = error
                raise
        return self._stored[key]

    def scalar(self, key: str, name: str) -> float:
        """Return one scalar of a result.

        Args:
            key: Key of the result.
            name: Name of the scalar.

        Raises:
            MissingScalar: If the result has no scalar of this name.
            MissingResult: If the result is missing or outdated.
            CorruptResult: If the file of the result cannot be read.
        """
        scalars = self[key].scalars
        if name not in scalars:
            raise MissingScalar(
                f"{self._path_of_result(key)} has no scalar {name!r} "
                f"(but {', '.join(sorted(scalars))}): "
                f"{_format_command_that_recomputes(key)} --force"
            )
        return scalars[name]

    def curves(self, key: str) -> dict[str, np.ndarray]:
        """Return the curves of a result: arrays by name, such as values along a line.

        Raises:
            StudyError: If the result was read from a record in version control, which has no
                curves.
        """
        stored = self[key]
        if stored.record:
            raise StudyError(
                f"{key} has no curves: it is read from {stored.record}, which has scalars only; "
                "show a scalar of the result, or a case that is computed"
            )
        return stored.curves

    def section(self, section: str) -> list[StoredResult]:
        """Return all results of a section, sorted by name of case.

        Raises:
            StudyError: If one of them cannot be read; see `readable_results`.
        """
        return [self[f"{section}/{case}"] for case in self.cases(section)]

    def readable_results(self, section: str) -> list[StoredResult]:
        """Return the results of a section that can be read, sorted by name of case."""
        results = []
        for case in self.cases(section):
            with suppress(MissingResult, CorruptResult):
                results.append(self[f"{section}/{case}"])
        return results

    def error_messages_of_corrupt_results(self, section: str) -> dict[str, str]:
        """Return the error message of each corrupt result of a section, by key."""
        messages = {}
        for case in self.cases(section):
            try:
                self[f"{section}/{case}"]
            except MissingResult:
                pass
            except CorruptResult as error:
                messages[f"{section}/{case}"] = str(error)
        return messages

    def where(self, section: str, /, **parameters: object) -> list[StoredResult]:
        """Return the results of a section that have the given parameters.

        Args:
            section: Name of the section.
            parameters: Value of each parameter, or a list of accepted values; see
                `StoredResult.has`.
        """
        return [stored for stored in self.section(section) if stored.has(**parameters)]

    def cases(self, section: str) -> list[str]:
        """Return the sorted names of a section's cases with a file, which may be unreadable."""
        if section not in self._names:
            paths = (self.folder / section).glob("*.json")
            self._names[section] = sorted(p.stem for p in paths if not p.name.startswith("."))
        return self._names[section]

    def claims(self) -> list[dict[str, Any]]:
        """Read the judged claims from `claims.json` in the folder of results.

        Raises:
            MissingResult: If the file does not exist.
            CorruptResult: If it cannot be read or is no list of claims.
        """
        path = self.folder / "claims.json"
        remedy = "write it again with ./run study report"
        try:
            claims = json.loads(path.read_bytes())
        except FileNotFoundError:
            raise MissingResult(f"there is no {path}: {remedy}") from None
        except (OSError, ValueError, RecursionError) as error:
            raise CorruptResult(f"{path} cannot be read ({error}): {remedy}") from None
        if not isinstance(claims, list) or not all(isinstance(claim, dict) for claim in claims):
            raise CorruptResult(f"{path} is not a list of claims: {remedy}")
        return claims

    def _path_of_result(self, key: str) -> Path:
        return self.folder / f"{key}.json"

    def _load(self, key: str) -> StoredResult:
        path = self._path_of_result(key)
        section, _, case = key.partition("/")
        try:
            content = json.loads(path.read_bytes(), parse_constant=_reject_nan_or_infinity)
            if _has_format_of_other_version(content):
                raise OutdatedResult(
                    f"{path} is of another version: {_format_command_that_recomputes(key)}"
                )
            _check_content_of_result_file(content, section, case)
            digest = content["provenance"].get("curves_sha256")
            data = (
                _read_and_check_packed_curves(path.with_suffix(".npz"), digest) if digest else b""
            )
            scalars = _to_floats(content["scalars"])
        except FileNotFoundError as error:
            if error.filename == str(path):
                raise MissingResult(
                    f"there is no result {path}: {_format_command_that_recomputes(key)}"
                ) from None
            raise CorruptResult(
                f"{error.filename} is missing: {_format_command_that_recomputes(key)}"
            ) from None
        except (OSError, ValueError, OverflowError, RecursionError) as error:
            raise CorruptResult(
                f"{path} cannot be used ({error}): {_format_command_that_recomputes(key)}"
            ) from None
        return StoredResult(
            section,
            case,
            content["parameters"],
            scalars,
            content["units"],
            partial(_unpack_curves, data),
            content["provenance"],
        )


class TrackedResults(Results):
    """View of stored results that records which results are read.

    Args:
        source: Results to read from, which are not modified.

    Attributes:
        keys: Keys of the results that have been read or whose existence has been checked.
        listed: Sections whose cases have been listed.
    """

    def __init__(self, source: Results) -> None:
        super().__init__(source.folder)
        self._source = source
        self.keys: set[str] = set()
        self.listed: set[str] = set()

    def __contains__(self, key: str) -> bool:
        self.keys.add(key)
        return key in self._source

    def __getitem__(self, key: str) -> StoredResult:
        self.keys.add(key)
        return self._source[key]

    def cases(self, section: str) -> list[str]:
        """Return the sorted case names of a section, and record that they were listed."""
        self.listed.add(section)
        return self._source.cases(section)

    @property
    def sections_read(self) -> set[str]:
        """Sections of which any result was read or checked, or whose cases were listed."""
        return self.listed | {key.partition("/")[0] for key in self.keys}


def _format_command_that_recomputes(key: str) -> str:
    return f"run ./run study {key}"


def _reject_nan_or_infinity(constant: str) -> float:
    raise ValueError(f"it contains {constant}")


def _check_content_of_result_file(content: object, section: str, case: str) -> None:
    if not isinstance(content, dict) or {*content} != _ENTRIES:
        raise ValueError(f"its keys are not {', '.join(sorted(_ENTRIES))}")
    if content["format"] != FORMAT:
        raise ValueError("its format has no name of the study's")
    if (content["section"], content["case"]) != (section, case):
        raise ValueError(f"it is of the case {content['section']}/{content['case']}")
    for part in _TABLES:
        if not isinstance(content[part], dict):
            raise ValueError(f"its {part} are no table")
    for name, value in content["scalars"].items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{name} is not a number")
    for name, unit in content["units"].items():
        if not isinstance(unit, str):
            raise ValueError(f"the unit of {name} is no text")
    if content["digest"] != _digest_entries_except_digest(content):
        raise ValueError("it has been edited since the run")


def _to_floats(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in numbers.items()}


def _read_and_check_packed_curves(path: Path, digest: str) -> bytes:
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != digest:
        raise ValueError(f"{path.name} is not of the same run")
    return data


def _unpack_curves(data: bytes) -> dict[str, np.ndarray]:
    if not data:
        return {}
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return dict(arrays)
