"""Results on disk: `<out>/<section>/<case>.json` for the numbers, `<case>.npz` for the curves."""

import hashlib
import io
import json
import math
import os
import re
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

# How the names of files end that are being written
_UNFINISHED = ".pw-elements-unfinished"


class StudyError(Exception):
    """Something that the user can mend; the command line prints it as one sentence."""


class MissingResult(StudyError):
    """A result has not been computed."""


class CorruptResult(StudyError):
    """A stored result cannot be read."""


@dataclass(frozen=True)
class Result:
    """What the run function of a case returns.

    Units are those in which a problem is stated: kN, kN/m² and m, or N, MPa and mm. A problem that
    states none has "unit force", "unit length" and "unit stress", any consistent ones; one whose
    quantities are made dimensionless has "1", as have ratios, counts and flags. Forces on a plane
    body are those on a thickness of one unit length, forces on an axisymmetric one are those on
    the whole circumference.

    Attributes:
        scalars: Finite numbers by name.
        units: The unit of each of them.
        curves: Arrays by name, of any shape; NaN marks a gap.
        dofs: Degrees of freedom of the discrete problem.
        processes: Number of MPI processes that took part.
    """

    scalars: Mapping[str, float]
    units: Mapping[str, str]
    curves: Mapping[str, np.ndarray] = field(default_factory=dict)
    dofs: int = 0
    processes: int = 1


@dataclass(frozen=True)
class Stored:
    """A result as read from disk; its curves are unpacked when they are first asked for."""

    section: str
    case: str
    parameters: dict[str, Any]
    scalars: dict[str, float]
    units: dict[str, str]
    unpack: Callable[[], dict[str, np.ndarray]]
    provenance: dict[str, Any]

    @cached_property
    def curves(self) -> dict[str, np.ndarray]:
        """Its arrays by name."""
        return self.unpack()

    @property
    def key(self) -> str:
        """Section and case, as in "7.1/pw-T6"."""
        return f"{self.section}/{self.case}"

    @property
    def record(self) -> str:
        """Tracked file from which the result was read; empty if it was computed."""
        return str(self.provenance.get("record") or "")

    def has(self, /, **parameters: object) -> bool:
        """Tell whether its parameters have these values; a list means any value of it.

        A parameter that is a list itself, like a mesh's divisions, has to be that list.
        """
        own = self.parameters
        return all(name in own and _is(own[name], value) for name, value in parameters.items())


def write_whole(path: Path, data: bytes) -> None:
    """Write a file wholly or not at all, making its folder if need be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # a name that nobody else knows, of a file that nobody else has made
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}.{os.getpid()}{_UNFINISHED}")
    unfinished = temporary.open("xb")
    try:
        with unfinished as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def sweep(out: Path) -> None:
    """Remove what `write_whole` left unfinished where its process was killed, and nothing else.

    It writes into the folder itself, and into folders in it.
    """
    for path in [*Path(out).glob(f".*{_UNFINISHED}"), *Path(out).glob(f"*/.*{_UNFINISHED}")]:
        written = re.fullmatch(rf"\..+\.[0-9a-f]{{16}}\.([0-9]{{1,9}}){_UNFINISHED}", path.name)
        if not written or path.is_symlink() or not path.is_file():
            continue
        try:
            os.kill(int(written[1]), 0)
        except ProcessLookupError:
            path.unlink(missing_ok=True)
        except PermissionError:  # it lives, and is another user's
            pass


def write_json(path: Path, content: object) -> None:
    """Write strict JSON wholly or not at all."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    write_whole(path, (text + "\n").encode())


def save(
    out: Path,
    section: str,
    case: str,
    result: Result,
    parameters: Mapping[str, Any],
    provenance: Mapping[str, Any],
) -> None:
    """Store a result; a process killed at any point leaves no mixture of old and new behind.

    The provenance receives digests: of the curves, so that a `.npz` of another run is noticed, and
    of parameters, scalars and units, so that an edited number is.

    Raises:
        StudyError: If there are no parameters, a scalar is not finite or has no unit, or a unit
            belongs to no scalar.
    """
    scalars = {name: float(value) for name, value in result.scalars.items()}
    units = dict(result.units)
    _refuse_incomplete(f"{section}/{case}", parameters, scalars, units)
    folder = Path(out) / section
    curves = folder / f"{case}.npz"
    digest = None
    if result.curves:
        data = _packed(result.curves)
        digest = hashlib.sha256(data).hexdigest()
        write_whole(curves, data)
    numbers = {"parameters": dict(parameters), "scalars": scalars, "units": units}
    content = {
        "case": case,
        **numbers,
        "provenance": {
            **provenance,
            "curves_sha256": digest,
            "numbers_sha256": _digest(**numbers),
        },
    }
    write_json(folder / f"{case}.json", content)  # last: it declares the result complete
    if digest is None:
        curves.unlink(missing_ok=True)


def discard(out: Path, section: str, case: str) -> None:
    """Remove a stored result, if there is one."""
    for suffix in (".json", ".npz"):
        (Path(out) / section / f"{case}{suffix}").unlink(missing_ok=True)


def _refuse_incomplete(
    key: str,
    parameters: Mapping[str, Any],
    scalars: Mapping[str, float],
    units: Mapping[str, str],
) -> None:
    if not parameters:
        raise StudyError(f"{key} has no parameters")
    bad = [f"{name} = {value}" for name, value in scalars.items() if not math.isfinite(value)]
    if bad:
        raise StudyError(f"{key} has numbers that are not finite: {', '.join(bad)}")
    bare = [name for name in scalars if not units.get(name)]
    if bare:
        raise StudyError(f"{key} has numbers without a unit: {', '.join(bare)}")
    idle = [name for name in units if name not in scalars]
    if idle:
        raise StudyError(f"{key} has units of no number: {', '.join(idle)}")


def _digest(
    parameters: Mapping[str, Any], scalars: Mapping[str, float], units: Mapping[str, str]
) -> str:
    """Digest of what a file says, whatever the order and the layout."""
    text = json.dumps([parameters, scalars, units], sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _is(own: object, wanted: object) -> bool:
    if isinstance(wanted, list | tuple):
        return own == list(wanted) if isinstance(own, list) else own in wanted
    return own == wanted


def _packed(curves: Mapping[str, np.ndarray]) -> bytes:
    arrays = {name: np.asarray(curve) for name, curve in curves.items()}
    objects = [name for name, array in arrays.items() if array.dtype.hasobject]
    if objects:
        raise StudyError(f"curves that are not plain numbers: {', '.join(objects)}")
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]  # its stub allows only a flag
    return stream.getvalue()


class Results:
    """Read access to a folder of results, by keys such as "7.1/pw-T6".

    Results and their names are read once and remembered; make a new object to see later changes.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self._read: dict[str, Stored] = {}
        self._names: dict[str, list[str]] = {}

    def __contains__(self, key: str) -> bool:
        return self._path(key).is_file()

    def __getitem__(self, key: str) -> Stored:
        if key not in self._read:
            self._read[key] = self._load(key)
        return self._read[key]

    def scalar(self, key: str, name: str) -> float:
        """Return one number of a result."""
        scalars = self[key].scalars
        if name not in scalars:
            raise CorruptResult(
                f"{self._path(key)} has no scalar {name!r} (but {', '.join(sorted(scalars))}): "
                f"{_remedy(key)}"
            )
        return scalars[name]

    def curves(self, key: str) -> dict[str, np.ndarray]:
        """Return the curves of a result.

        Raises:
            StudyError: If the result was read from a tracked record, which has scalars only.
        """
        stored = self[key]
        if stored.record:
            raise StudyError(
                f"{key} has no curves: it is read from {stored.record}, which has scalars only; "
                "show a scalar of the result, or a case that is computed"
            )
        return stored.curves

    def section(self, section: str) -> list[Stored]:
        """Return all results of a section, sorted by case."""
        return [self[f"{section}/{case}"] for case in self.cases(section)]

    def where(self, section: str, /, **parameters: object) -> list[Stored]:
        """Return the results of a section with these parameters, see `Stored.has`."""
        return [stored for stored in self.section(section) if stored.has(**parameters)]

    def cases(self, section: str) -> list[str]:
        """Return the names of a section's results, sorted, readable or not."""
        if section not in self._names:
            paths = (self.folder / section).glob("*.json")
            self._names[section] = sorted(p.stem for p in paths if not p.name.startswith("."))
        return self._names[section]

    def claims(self) -> list[dict[str, Any]]:
        """Return the judged claims, as `study.judge.claims.write` left them."""
        path = self.folder / "claims.json"
        remedy = "write it again with ./run study report"
        try:
            claims = json.loads(path.read_bytes())
        except FileNotFoundError:
            raise MissingResult(f"there is no {path}: {remedy}") from None
        except (OSError, ValueError) as error:
            raise CorruptResult(f"{path} cannot be read ({error}): {remedy}") from None
        if not isinstance(claims, list) or not all(isinstance(claim, dict) for claim in claims):
            raise CorruptResult(f"{path} is not a list of claims: {remedy}")
        return claims

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"

    def _load(self, key: str) -> Stored:
        path = self._path(key)
        section, _, case = key.partition("/")
        try:
            content = json.loads(path.read_bytes(), parse_constant=_refuse)
            _check(content, case)
            digest = content["provenance"].get("curves_sha256")
            data = _data(path.with_suffix(".npz"), digest) if digest else b""
        except FileNotFoundError as error:
            if error.filename == str(path):
                raise MissingResult(
                    f"there is no result {path}: run ./run study {section}"
                ) from None
            raise CorruptResult(f"{error.filename} is missing: {_remedy(key)}") from None
        except (OSError, ValueError) as error:
            raise CorruptResult(f"{path} cannot be used ({error}): {_remedy(key)}") from None
        return Stored(
            section,
            case,
            content["parameters"],
            _floats(content["scalars"]),
            content["units"],
            partial(_unpacked, data),
            content["provenance"],
        )


class TrackedResults(Results):
    """Results that note what is read of them.

    Args:
        source: The results; they stay as they are.

    Attributes:
        keys: Keys of the results that were read, or whose presence was asked for.
        listed: Sections whose cases were listed.
    """

    def __init__(self, source: Results) -> None:
        super().__init__(source.folder)
        self._source = source
        self.keys: set[str] = set()
        self.listed: set[str] = set()

    def __contains__(self, key: str) -> bool:
        self.keys.add(key)
        return key in self._source

    def __getitem__(self, key: str) -> Stored:
        self.keys.add(key)
        return self._source[key]

    def cases(self, section: str) -> list[str]:
        """Return the names of a section's results, sorted, readable or not."""
        self.listed.add(section)
        return self._source.cases(section)

    @property
    def sections(self) -> set[str]:
        """Sections of all that was read."""
        return self.listed | {key.partition("/")[0] for key in self.keys}


def _remedy(key: str) -> str:
    return f"run ./run study {key.partition('/')[0]} --force"


def _refuse(constant: str) -> float:
    raise ValueError(f"it contains {constant}")


def _check(content: object, case: str) -> None:
    parts = ("parameters", "scalars", "units", "provenance")
    if not isinstance(content, dict) or set(content) != {"case", *parts}:
        raise ValueError(f"its keys are not case, {', '.join(parts)}")
    if content["case"] != case:
        raise ValueError(f"it is of the case {content['case']!r}")
    for part in parts:
        if not isinstance(content[part], dict):
            raise ValueError(f"its {part} are no table")
    for name, value in content["scalars"].items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{name} is not a number")
    for name, unit in content["units"].items():
        if not isinstance(unit, str):
            raise ValueError(f"the unit of {name} is no text")
    found = _digest(content["parameters"], _floats(content["scalars"]), content["units"])
    if content["provenance"].get("numbers_sha256") != found:
        raise ValueError("its parameters, scalars or units have been edited since the run")


def _floats(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in numbers.items()}


def _data(path: Path, digest: str) -> bytes:
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != digest:
        raise ValueError(f"{path.name} is not of the same run")
    return data


def _unpacked(data: bytes) -> dict[str, np.ndarray]:
    if not data:
        return {}
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return dict(arrays)
