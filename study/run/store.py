"""Store results, numbers in `<out>/<section>/<case>.json` and curves in `<case>.npz`."""

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
    """Error that the user can correct; the command line prints it without a traceback."""


class MissingResult(StudyError):
    """A result has not been computed."""


class OutdatedResult(MissingResult):
    """A result has the format of another version."""


class CorruptResult(StudyError):
    """A stored file cannot be read, or was modified after the run."""


class MissingScalar(StudyError):
    """A stored result has no scalar with the given name."""


@dataclass(frozen=True)
class Result:
    """Result that the function of a case returns.

    Units are those in which the problem is stated: kN, kN/m² and m, or N, MPa and mm. If a problem
    is stated without units, its units are "unit force", "unit length" and "unit stress", which
    stand for any consistent units. Dimensionless quantities, ratios, counts and flags have the
    unit "1". Forces on a plane body refer to a thickness of one unit length, and forces on an
    axisymmetric body to the whole circumference.

    Attributes:
        scalars: Finite numbers by name.
        units: Unit of each scalar.
        curves: Arrays of any shape by name; NaN marks a gap.
        dofs: Degrees of freedom of the discrete problem.
        processes: Number of MPI processes that took part.
    """

    scalars: Mapping[str, float]
    units: Mapping[str, str]
    curves: Mapping[str, np.ndarray] = field(default_factory=dict)
    dofs: int = 0
    processes: int = 1


@dataclass(frozen=True)
class StoredResult:
    """Result that has been read from disk; its curves are unpacked when they are first used."""

    section: str
    case: str
    parameters: dict[str, Any]
    scalars: dict[str, float]
    units: dict[str, str]
    unpack: Callable[[], dict[str, np.ndarray]]
    provenance: dict[str, Any]

    @cached_property
    def curves(self) -> dict[str, np.ndarray]:
        """Arrays by name."""
        return self.unpack()

    @property
    def key(self) -> str:
        """Section and case, such as "7.1/pw-T6"."""
        return f"{self.section}/{self.case}"

    @property
    def record(self) -> str:
        """Tracked file from which the result was read; empty if it was computed."""
        return str(self.provenance.get("record") or "")

    def has(self, /, **parameters: object) -> bool:
        """Return whether each named parameter has the given value, or a value in the given list.

        A parameter that is itself a list, such as the divisions of a mesh, must equal the list.
        """
        return all(
            name in self.parameters and _has_value(self.parameters[name], value)
            for name, value in parameters.items()
        )


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file atomically; create its folder if it does not exist."""
    path.parent.mkdir(parents=True, exist_ok=True)
    files.replace_file_atomically(path, data)


def remove_unfinished_files(out: Path) -> None:
    """Remove unfinished files of killed processes from a folder and its subfolders."""
    for folder in (Path(out), *Path(out).glob("*/")):
        files.remove_files_of_killed_processes(folder)


def write_json(path: Path, content: object) -> None:
    """Write a file of strict JSON atomically."""
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
    """Store a result.

    The file contains a digest of its content, which is the section, case, parameters, numbers and
    provenance, including the fingerprint and the digest of the curves. Reading the file therefore
    detects edited numbers, files of another section, a `.npz` file of another run, and mixed files
    that a killed process has left.

    Raises:
        StudyError: If there are no parameters, if a scalar is not finite or has no unit, or if a
            unit does not belong to any scalar.
    """
    scalars = {name: float(value) for name, value in result.scalars.items()}
    units = dict(result.units)
    _check_complete(f"{section}/{case}", parameters, scalars, units)
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
    content["digest"] = _digest_content(content)
    write_json(folder / f"{case}.json", content)  # last, because it completes the result
    if digest is None:
        files.remove_file_if_present(curves)


def discard(out: Path, section: str, case: str) -> None:
    """Remove a stored result if it exists."""
    for suffix in (".json", ".npz"):
        files.remove_file_if_present(Path(out) / section / f"{case}{suffix}")


def is_result_file(path: Path) -> bool:
    """Return whether a file has the keys of a stored result in this or another format."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and ({*content} == _ENTRIES or _is_other_version(content))


def _is_other_version(content: object) -> bool:
    if not isinstance(content, dict):
        return False
    is_other_format = (
        str(content.get("format")).startswith(f"{_FORMAT_NAME} ") and content["format"] != FORMAT
    )
    return is_other_format or {*content} == _ENTRIES_OF_FIRST_FORMAT


def _check_complete(
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


def _digest_content(content: Mapping[str, Any]) -> str:
    """Return the digest of all entries except the digest itself, regardless of order and layout."""
    entries = {name: part for name, part in content.items() if name != "digest"}
    text = json.dumps(entries, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _has_value(stored: object, expected: object) -> bool:
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
    """Read access to a folder of results by keys such as "7.1/pw-T6".

    Results and their names are cached; create a new object to see later changes.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self._stored: dict[str, StoredResult] = {}
        self._errors: dict[str, StudyError] = {}
        self._names: dict[str, list[str]] = {}

    def __contains__(self, key: str) -> bool:
        return self._path(key).is_file()

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
        """Return one scalar of a result."""
        scalars = self[key].scalars
        if name not in scalars:
            raise MissingScalar(
                f"{self._path(key)} has no scalar {name!r} (but {', '.join(sorted(scalars))}): "
                f"{_format_remedy(key)} --force"
            )
        return scalars[name]

    def curves(self, key: str) -> dict[str, np.ndarray]:
        """Return the curves of a result.

        Raises:
            StudyError: If the result was read from a tracked record, which has no curves.
        """
        stored = self[key]
        if stored.record:
            raise StudyError(
                f"{key} has no curves: it is read from {stored.record}, which has scalars only; "
                "show a scalar of the result, or a case that is computed"
            )
        return stored.curves

    def section(self, section: str) -> list[StoredResult]:
        """Return all results of a section, sorted by name of case."""
        return [self[f"{section}/{case}"] for case in self.cases(section)]

    def readable_results(self, section: str) -> list[StoredResult]:
        """Return the readable results of a section, sorted by name of case."""
        results = []
        for case in self.cases(section):
            with suppress(MissingResult, CorruptResult):
                results.append(self[f"{section}/{case}"])
        return results

    def corrupt_results(self, section: str) -> dict[str, str]:
        """Return the error messages of the unreadable results of a section, by key."""
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
        """Return the results of a section whose parameters match; see `StoredResult.has`."""
        return [stored for stored in self.section(section) if stored.has(**parameters)]

    def cases(self, section: str) -> list[str]:
        """Return the sorted names of all results of a section, including unreadable ones."""
        if section not in self._names:
            paths = (self.folder / section).glob("*.json")
            self._names[section] = sorted(p.stem for p in paths if not p.name.startswith("."))
        return self._names[section]

    def claims(self) -> list[dict[str, Any]]:
        """Return the judged claims that `study.judge.claims` has written."""
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

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"

    def _load(self, key: str) -> StoredResult:
        path = self._path(key)
        section, _, case = key.partition("/")
        try:
            content = json.loads(path.read_bytes(), parse_constant=_refuse_constant)
            if _is_other_version(content):
                raise OutdatedResult(f"{path} is of another version: {_format_remedy(key)}")
            _check_content(content, section, case)
            digest = content["provenance"].get("curves_sha256")
            data = _read_curves(path.with_suffix(".npz"), digest) if digest else b""
            scalars = _to_floats(content["scalars"])
        except FileNotFoundError as error:
            if error.filename == str(path):
                raise MissingResult(f"there is no result {path}: {_format_remedy(key)}") from None
            raise CorruptResult(f"{error.filename} is missing: {_format_remedy(key)}") from None
        except (OSError, ValueError, OverflowError, RecursionError) as error:
            raise CorruptResult(f"{path} cannot be used ({error}): {_format_remedy(key)}") from None
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
    """View of stored results that keeps track of which results are read.

    Args:
        source: Results to read from, which are not modified.

    Attributes:
        keys: Keys of results that have been read or looked up.
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
        """Return the sorted names of all results of a section, including unreadable ones."""
        self.listed.add(section)
        return self._source.cases(section)

    @property
    def sections(self) -> set[str]:
        """Sections of all results that have been read, looked up or listed."""
        return self.listed | {key.partition("/")[0] for key in self.keys}


def _format_remedy(key: str) -> str:
    return f"run ./run study {key}"


def _refuse_constant(constant: str) -> float:
    raise ValueError(f"it contains {constant}")


def _check_content(content: object, section: str, case: str) -> None:
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
    if content["digest"] != _digest_content(content):
        raise ValueError("it has been edited since the run")


def _to_floats(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in numbers.items()}


def _read_curves(path: Path, digest: str) -> bytes:
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != digest:
        raise ValueError(f"{path.name} is not of the same run")
    return data


def _unpack_curves(data: bytes) -> dict[str, np.ndarray]:
    if not data:
        return {}
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return dict(arrays)
