"""Data for reproducing the study: versions, processor, computing time and digest of the numbers.

`python3 -m study.publish.reproducibility [FOLDER]` prints the digest of a folder of results.

Each result is stored with the versions on which its validity depends. All other versions and the
processor are those of the environment that writes the report. If they were stored with the results,
any difference in them would outdate all results.
"""

import ctypes
import hashlib
import json
import os
import platform
import re
import sys
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from study.run import records
from study.run.cases import SECTIONS
from study.run.store import Results, StoredResult

MEASURED_SCALAR = re.compile(r"(seconds|megabytes|over_linear|over_bare|over_solutions)$")
"""Pattern for names of scalars that differ in each run: measured times, memory and ratios."""

LIBRARY_NAMES = {
    "dolfinx": "DOLFINx",
    "basix": "Basix",
    "ufl": "UFL",
    "ffcx": "FFCx",
    "petsc": "PETSc",
    "slepc": "SLEPc",
    "numpy": "NumPy",
}
"""Displayed names of the packages whose versions are stored with each result."""

_PROJECT_FOLDER = Path(__file__).parents[2]
_MUMPS_VERSION = re.compile(rb"(?<![\d.])[4-9]\.\d{1,2}\.\d{1,2}(?![\d.])")


class ComputingTime(NamedTuple):
    """Computing time of all results, divided into computed and recorded results.

    Attributes:
        computed_seconds: Elapsed seconds multiplied by the number of processes, summed over the
            computed results.
        recorded_seconds: CPU seconds, summed over the results that were read from the records in
            version control.
        n_results: Number of results of both types.
    """

    computed_seconds: float
    recorded_seconds: float
    n_results: int


def read_stored_versions(results: Results) -> dict[str, list[str]]:
    """Return, by library, the sorted versions with which the stored results were computed."""
    versions: dict[str, set[str]] = {}
    for result in _list_all_readable_results(results):
        for package, version in result.provenance.get("versions", {}).items():
            versions.setdefault(LIBRARY_NAMES.get(package, package), set()).add(version)
    return {name: sorted(versions[name]) for name in LIBRARY_NAMES.values() if name in versions} | {
        name: sorted(found) for name, found in sorted(versions.items())
    }


@cache
def read_versions_not_stored_with_results() -> dict[str, str]:
    """Return the versions of MUMPS, BLAS, SciPy and Python, which are not stored with results.

    MUMPS and BLAS are identified from the shared libraries that PETSc, NumPy and SciPy load.
    """
    for module in ("scipy.linalg", "petsc4py.PETSc"):
        try:
            import_module(module)
        except ImportError:
            continue
    libraries = _list_loaded_libraries()
    return {
        "MUMPS": read_mumps_version(libraries),
        "BLAS": read_blas_version(libraries),
        "SciPy": _read_distribution_version("scipy"),
        "Python": platform.python_version(),
    }


def read_mumps_version(shared_libraries: list[Path]) -> str:
    """Return the version number contained in the double-precision library of MUMPS.

    Args:
        shared_libraries: Shared libraries, e.g. those of `_list_loaded_libraries`.

    Returns:
        The version, or "not identified" if there is no such library or no unique version number.
    """
    for library in shared_libraries:
        if library.name.startswith("libdmumps"):
            versions = {match.decode() for match in _MUMPS_VERSION.findall(library.read_bytes())}
            if len(versions) == 1:
                return versions.pop()
    return "not identified"


def read_blas_version(shared_libraries: list[Path]) -> str:
    """Return name and version of each loaded BLAS library, or its file name if it is not OpenBLAS.

    There may be several, because NumPy may use a different BLAS than PETSc.

    Args:
        shared_libraries: Shared libraries, e.g. those of `_list_loaded_libraries`.

    Returns:
        Names separated by commas, or "not identified".
    """
    names = set()
    for library in shared_libraries:
        if "openblas" in library.name:
            names.add(_read_openblas_version(library))
        elif re.match(r"lib(blis|mkl_rt|mkl_core|atlas)\b", library.name):
            names.add(library.name)
    return ", ".join(sorted(names)) or "not identified"


def describe_processor() -> str:
    """Return the processor of this machine and the number of cores available to this process."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    n_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{(models or [platform.machine()])[0]}, {n_cores} cores"


def sum_computing_time(results: Results) -> ComputingTime:
    """Return the computing time of all readable results."""
    rows = records.read_rows(records.COSTLY_CASES)
    computed = recorded = 0.0
    n_results = 0
    for result in _list_all_readable_results(results):
        n_results += 1
        if not result.record:
            provenance = result.provenance
            computed += provenance.get("seconds", 0.0) * (provenance.get("processes") or 1)
        elif result.key in rows:
            recorded += rows[result.key].content["seconds"]
    return ComputingTime(computed, recorded, n_results)


def digest_scalars_and_curves(results: Results) -> str:
    """Return the hexadecimal SHA-256 digest of all scalars and curves of all readable results.

    The digest covers keys of results, and names and values of scalars and curves, regardless of
    their order. It excludes provenance and measured time and memory. Since every bit of a value
    counts, processors with different round-off give different digests.
    """
    lines = []
    for result in _list_all_readable_results(results):
        lines += [
            f"{result.key} {name} {value + 0.0!r}"  # -0.0 is 0.0
            for name, value in result.scalars.items()
            if not MEASURED_SCALAR.search(name)
        ]
        lines += [
            f"{result.key} {name} {_digest_array(curve)}" for name, curve in result.curves.items()
        ]
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


def list_commits(results: Results) -> list[str]:
    """Return the sorted, abbreviated commits with which the results were computed.

    A commit ends in "+" if files had been modified.
    """
    return sorted(
        {
            f"{commit[:10]}{'+' if result.provenance.get('dirty') else ''}"
            for result in _list_all_readable_results(results)
            if (commit := result.provenance.get("commit"))
        }
    )


def read_citation() -> dict[str, str]:
    """Return the title, version, licence and author of the software from CITATION.cff."""
    text = (_PROJECT_FOLDER / "CITATION.cff").read_text(encoding="utf-8")
    fields = {
        name: re.search(rf'^{name}: "?(.*?)"?$', text, re.MULTILINE)
        for name in ("title", "version", "license", "repository-code", "doi")
    }
    authors = re.findall(r"^  - name: (.*)$", text.partition("references:")[0], re.MULTILINE)
    return {name: match[1] if match else "" for name, match in fields.items()} | {
        "author": ", ".join(authors)
    }


def summarize_reproducibility(results: Results) -> dict[str, Any]:
    """Collect the data for the box on reproducibility in the report: versions, time, digest etc."""
    return {
        "stored_versions": read_stored_versions(results),
        "environment_versions": read_versions_not_stored_with_results(),
        "processor": describe_processor(),
        "time": sum_computing_time(results),
        "digest": digest_scalars_and_curves(results),
        "commits": list_commits(results),
        "citation": read_citation(),
    }


def _list_all_readable_results(results: Results) -> list[StoredResult]:
    return [result for section in SECTIONS for result in results.readable_results(section)]


def _digest_array(array: np.ndarray) -> str:
    """Return a digest of the shape and values of an array, regardless of its data type."""
    if array.dtype.kind in "biuf":
        values = np.ascontiguousarray(array, dtype="<f8") + 0.0
        values[np.isnan(values)] = np.nan  # all NaNs get the same bits
        content = values.tobytes()
    else:
        content = json.dumps(array.astype(str).tolist()).encode()
    return hashlib.sha256(repr(array.shape).encode() + content).hexdigest()


def _list_loaded_libraries() -> list[Path]:
    """Return the sorted shared libraries loaded by this process; empty on systems without /proc."""
    try:
        lines = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    paths = {fields[-1] for line in lines if ".so" in (fields := line.split(maxsplit=5))[-1]}
    return [Path(path) for path in sorted(paths) if Path(path).is_file()]


def _read_openblas_version(library: Path) -> str:
    """Return a text such as "OpenBLAS 0.3.26", or the file name if the library gives no version."""
    try:
        read_configuration = ctypes.CDLL(str(library)).openblas_get_config
    except (AttributeError, OSError):
        return library.name
    read_configuration.restype = ctypes.c_char_p
    configuration = (read_configuration() or b"").decode()
    match = re.match(r"OpenBLAS \d[\w.]*", configuration)
    return match[0] if match else library.name


def _read_distribution_version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "absent"


if __name__ == "__main__":
    print(digest_scalars_and_curves(Results(sys.argv[1] if len(sys.argv) > 1 else "results")))
