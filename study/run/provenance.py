"""Collect the provenance of results: commit, package versions, computing time and problem size."""

import os
import subprocess
from datetime import UTC, datetime
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

PACKAGES = {
    "dolfinx": ("fenics-dolfinx", "dolfinx"),
    "basix": ("fenics-basix", "basix"),
    "ffcx": ("fenics-ffcx", "ffcx"),
    "ufl": ("fenics-ufl", "ufl"),
    "petsc": ("petsc4py", "petsc4py"),
    "slepc": ("slepc4py", "slepc4py"),
    "numpy": ("numpy", "numpy"),
}
"""Name of the distribution and of the module of each package, by short name.

The versions of petsc4py and slepc4py equal those of PETSc and SLEPc.
"""


@cache
def package_versions() -> dict[str, str]:
    """Return the version of each package in `PACKAGES`, or "absent", by short name.

    Packages are imported only if they have no metadata.
    """
    return {name: _read_version(*package) for name, package in PACKAGES.items()}


def create_provenance(
    seconds: float, dofs: int, processes: int, fingerprint: str, record: str = ""
) -> dict[str, Any]:
    """Return the provenance that is stored with a result.

    Args:
        seconds: Elapsed time of the computation in seconds.
        dofs: Number of degrees of freedom of the discrete problem.
        processes: Number of MPI processes.
        fingerprint: Digest of everything that the result depends on.
        record: File from which the result was read, relative to the project's folder; empty if it
            was computed.
    """
    commit, dirty = _read_commit_and_whether_modified()
    return {
        "commit": commit,
        "dirty": dirty,
        "versions": dict(package_versions()),
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": seconds,
        "dofs": dofs,
        "processes": processes,
        "fingerprint": fingerprint,
        "record": record or None,
    }


def _read_version(distribution: str, module: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        pass
    try:
        return str(getattr(import_module(module), "__version__", "unknown"))
    except ImportError:
        return "absent"


def _read_commit_and_whether_modified() -> tuple[str, bool | None]:
    """Return the commit and whether files differ from it (None if unknown).

    Both are read from the environment variables that ./run sets, or otherwise from git.
    """
    commit = os.environ.get("PW_ELEMENTS_COMMIT")
    if commit:
        return commit, {"1": True, "0": False}.get(os.environ.get("PW_ELEMENTS_DIRTY", ""))
    try:
        return _run_git("rev-parse", "HEAD"), bool(_run_git("status", "--porcelain"))
    except (OSError, subprocess.CalledProcessError):
        return "unknown", None


def _run_git(*arguments: str) -> str:
    folder = Path(__file__).parent
    command = ["git", "-C", str(folder), *arguments]
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    return process.stdout.strip()
