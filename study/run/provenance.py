"""Where a result comes from: commit, versions, time and size."""

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
"""Distribution and module of each package; petsc4py and slepc4py carry the libraries' versions."""


@cache
def versions() -> dict[str, str]:
    """Return the versions of the packages, imported only if they carry no metadata."""
    return {name: _version(*package) for name, package in PACKAGES.items()}


def provenance(
    seconds: float, dofs: int, processes: int, fingerprint: str, record: str = ""
) -> dict[str, Any]:
    """Return what is stored beside a result's numbers.

    Args:
        seconds: Wall time of the computation.
        dofs: Degrees of freedom of the discrete problem.
        processes: Number of MPI processes that took part.
        fingerprint: Digest of all that the result depends on.
        record: Tracked file from which the result was read; empty if it was computed.
    """
    commit, dirty = _commit()
    return {
        "commit": commit,
        "dirty": dirty,
        "versions": dict(versions()),
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": seconds,
        "dofs": dofs,
        "processes": processes,
        "fingerprint": fingerprint,
        "record": record or None,
    }


def _version(distribution: str, module: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        pass
    try:
        return str(getattr(import_module(module), "__version__", "unknown"))
    except ImportError:
        return "absent"


def _commit() -> tuple[str, bool | None]:
    """Return the commit and whether files differ from it; ./run may have looked them up."""
    commit = os.environ.get("PW_ELEMENTS_COMMIT")
    if commit:
        return commit, {"1": True, "0": False}.get(os.environ.get("PW_ELEMENTS_DIRTY", ""))
    try:
        return _git("rev-parse", "HEAD"), bool(_git("status", "--porcelain"))
    except (OSError, subprocess.CalledProcessError):
        return "unknown", None


def _git(*arguments: str) -> str:
    folder = Path(__file__).parent
    command = ["git", "-C", str(folder), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.strip()
