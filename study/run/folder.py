"""The folder of results: made and marked, and nobody else's."""

import tempfile
from pathlib import Path

from study.run.cases import SECTIONS
from study.run.files import ForeignFileOrFolder, create_or_claim_folder
from study.run.store import StudyError, is_result

KIND = "a folder of results"
# What is in it besides the sections' folders
FILES = ("claims.json", "cost.json", "report.html", "report.pdf")
FOLDERS = ("figures", "gallery", "site")


def ensure_writable(out: Path) -> None:
    """Make a folder of results, unless it is one, and look whether it can be written to.

    Raises:
        StudyError: If it cannot, or is someone else's.
    """
    claim_results_folder(out)
    try:
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise _not_writable(out, error) from None


def claim_results_folder(out: Path) -> None:
    """Make a folder of results, unless it is one; one without a mark is known by what is in it.

    Raises:
        StudyError: If it cannot be made, or is someone else's: files of some names in it would be
            replaced.
    """
    try:
        create_or_claim_folder(out, KIND, _holds_results)
    except ForeignFileOrFolder as error:
        raise StudyError(str(error)) from None
    except OSError as error:
        raise _not_writable(out, error) from None


def _not_writable(out: Path, error: OSError) -> StudyError:
    return StudyError(f"{out} cannot be written to: {error.strerror}")


def _holds_results(folder: Path) -> bool:
    """Tell whether there is nothing but what the study writes, and at least one result."""
    names = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    if names - {*SECTIONS, *FILES, *FOLDERS}:
        return False
    return any(is_result(path) for one in SECTIONS for path in (folder / one).glob("*.json"))
