"""Create and mark the folder of results, and refuse folders that the study has not created."""

import tempfile
from pathlib import Path

from study.run.cases import SECTIONS
from study.run.files import ForeignFileOrFolder, create_or_claim_folder
from study.run.store import StudyError, is_result_file

FOLDER_KIND = "a folder of results"
# Permitted entries in addition to the folders of sections
RESULT_FILES = ("claims.json", "cost.json", "report.html", "report.pdf")
RESULT_FOLDERS = ("figures", "gallery", "site")


def create_writable_results_folder(out: Path) -> None:
    """Create the folder of results if it does not exist, and check that files can be written to it.

    Raises:
        StudyError: If the folder is not writable, or contains files of other programs.
    """
    create_or_mark_results_folder(out)
    try:
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise _create_not_writable_error(out, error) from None


def create_or_mark_results_folder(out: Path) -> None:
    """Create the folder of results if it does not exist, and mark it as created by the study.

    An existing folder without mark is accepted if it contains a result and no files that the study
    would not write.

    Raises:
        StudyError: If the folder cannot be created, or if it contains other files, which the study
            might overwrite.
    """
    try:
        create_or_claim_folder(out, FOLDER_KIND, _has_results_and_no_foreign_entries)
    except ForeignFileOrFolder as error:
        raise StudyError(str(error)) from None
    except OSError as error:
        raise _create_not_writable_error(out, error) from None


def _create_not_writable_error(out: Path, error: OSError) -> StudyError:
    return StudyError(f"{out} cannot be written to: {error.strerror}")


def _has_results_and_no_foreign_entries(folder: Path) -> bool:
    """Return whether a folder contains a result, and only entries that the study writes."""
    names = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    if names - {*SECTIONS, *RESULT_FILES, *RESULT_FOLDERS}:
        return False
    return any(
        is_result_file(path) for section in SECTIONS for path in (folder / section).glob("*.json")
    )
