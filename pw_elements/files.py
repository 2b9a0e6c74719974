"""Atomic replacement of files and folders.

The library and the study create, replace and delete files only through this module.

- A file is written under a temporary name in the same folder and then renamed. At any moment the
  path holds either the old or the new file. After an error it holds the old file. The caller may
  restrict which existing files are replaced.
- A folder is also written under a temporary name and then exchanged with the old folder. An
  existing folder is replaced only if its mark, a file named ".pw-elements", lists its whole
  content. Files that the library did not write are therefore never deleted with a folder.
- Unfinished files and folders have names that end in ".pw-elements-unfinished". The process that
  writes an unfinished file or folder holds a lock on it, which ends with the process. The next
  process that writes in the same folder removes unfinished files and folders without a lock. Those
  with a lock belong to running processes, possibly in other containers, and are kept. On file
  systems without locks, all unfinished files and folders are kept.

Some network file systems cannot exchange two folders. There, a process that is killed between two
renames leaves no folder at the path, and the next process that writes there restores the old
folder.
"""

import ctypes
import errno
import fcntl
import json
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

FOLDER_MARK_FILE_NAME = ".pw-elements"

_MARK_CREATOR_NAME = "pw_elements"
_UNFINISHED_SUFFIX = ".pw-elements-unfinished"
_UNFINISHED_NAME_PATTERN = re.compile(rf"\.[0-9a-f]{{16}}{re.escape(_UNFINISHED_SUFFIX)}")
# Name of the old folder during its replacement, on systems that cannot exchange two folders
_REPLACED_FOLDER_NAME = ".replaced"
_SCRATCH_FOLDER_NAME = ".scratch"
_TEMPORARY_FOLDER_KIND = "unfinished"  # kind of the temporary folder that holds the new folder
# Attempts to create and lock a new file: another process may remove the file before it is locked
_MAX_CREATION_ATTEMPTS = 10
_MAX_NAMES_IN_MESSAGE = 3
# Constants of Linux' renameat2(2)
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2
_EXCHANGE_UNSUPPORTED_ERROR_NUMBERS = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)


class ForeignFileOrFolder(FileExistsError):
    """A path holds a file or folder that the library did not write and must not replace."""


@contextmanager
def open_replacement_file(
    path: Path, may_replace: Callable[[Path], bool] | None = None
) -> Iterator[IO[bytes]]:
    """Open a file that replaces the file at a path, or creates it, when the block ends.

    Args:
        path: Path of the file, in an existing folder. If it is a link, its target is replaced.
        may_replace: Function that returns whether the existing file at a path may be replaced. By
            default any regular file may be replaced.

    Raises:
        ForeignFileOrFolder: If the path holds something that must not be replaced.
        OSError: If the file cannot be written. The old file is unchanged in this case.
    """
    path = path.resolve()
    check_file_replaceable(path, may_replace)
    remove_files_of_killed_processes(path.parent)
    with _name_final_path_in_errors(path):
        temporary, descriptor = _create_locked_temporary_file(path.parent)
        try:
            with os.fdopen(descriptor, "wb") as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
                check_file_replaceable(path, may_replace)
                os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise


def replace_file_atomically(
    path: Path, content: bytes, may_replace: Callable[[Path], bool] | None = None
) -> None:
    """Write a file completely or not at all; the arguments are those of `open_replacement_file`."""
    with open_replacement_file(path, may_replace) as stream:
        stream.write(content)


def remove_file_if_present(path: Path) -> None:
    """Remove the file at a path, if there is one."""
    with suppress(FileNotFoundError):
        os.unlink(path)


class FolderReplacement:
    """Creation of a folder at a path, or replacement of the existing folder by a new one.

    Call `start`, write files into `folder`, and call `commit`, all on one process. `abandon`
    removes a new folder that has not been committed. The context manager
    `open_folder_replacement` makes these calls.

    Args:
        path: Path of the folder, in an existing folder. If it is a link, its target is replaced.
        kind: Description of the folder, such as "a site". Folders of another kind are not
            replaced.
        durable: Whether the content has to survive a loss of power. This costs time for each file.

    Attributes:
        folder: New folder, to be filled. Its name is that of `path`.
        scratch: Folder for temporary files.
    """

    def __init__(self, path: Path, kind: str, durable: bool = False) -> None:
        self.path, self.kind, self.durable = path.resolve(), kind, durable
        self._container: tuple[Path, int] | None = None

    def start(self) -> None:
        """Create `folder` and `scratch`.

        Raises:
            ForeignFileOrFolder: If the path holds something that must not be replaced.
            OSError: If the folders cannot be created.
        """
        check_folder_replaceable(self.path, self.kind)
        remove_files_of_killed_processes(self.path.parent)
        with _name_final_path_in_errors(self.path):
            self._container = _create_locked_temporary_folder(self.path)
            container, _ = self._container
            self.folder, self.scratch = container / self.path.name, container / _SCRATCH_FOLDER_NAME
            try:
                for folder in (self.folder, self.scratch):
                    os.mkdir(folder)
            except BaseException:
                self.abandon()
                raise

    def commit(self) -> None:
        """Move the new folder to the path, and delete the old folder.

        Raises:
            ForeignFileOrFolder: If the path now holds something that must not be replaced.
            OSError: If the new folder cannot be moved. The old folder is unchanged in this case.
        """
        with _name_final_path_in_errors(self.path):
            entries = sorted(_list_relative_paths(self.folder))
            if self.durable:
                for entry in entries:
                    _sync_file(self.folder / entry)
            _write_folder_mark(self.folder, self.kind, entries)
            check_folder_replaceable(self.path, self.kind)
            if os.path.lexists(self.path) and not _list_relative_paths(self.path):
                _remove_marked_folder(
                    self.path, []
                )  # an exchange could move files that are being added at this moment
            if not os.path.lexists(self.path):
                os.rename(self.folder, self.path)
            else:
                self._exchange_with_target()
        self.abandon()

    def _exchange_with_target(self) -> None:
        """Exchange the new folder and the old one; undo this if the old one must be kept."""
        replaced = self.folder
        if not _exchange_folders(self.folder, self.path):
            replaced = self.folder.with_name(_REPLACED_FOLDER_NAME)
            os.rename(self.path, replaced)
            try:
                os.rename(self.folder, self.path)
            except BaseException:
                os.rename(replaced, self.path)
                raise
        try:
            check_folder_replaceable(replaced, self.kind)
        except BaseException:  # a file may have been added since the last check
            if replaced == self.folder:
                _exchange_folders(self.folder, self.path)
            else:
                os.rename(self.path, self.folder)
                os.rename(replaced, self.path)
            raise

    def abandon(self) -> None:
        """Remove a folder that has not been committed.

        Files that cannot be removed now are removed by the next process that writes there.
        """
        if self._container is None:
            return
        container, descriptor = self._container
        self._container = None
        with suppress(OSError):
            _remove_temporary_folder(container)
        with suppress(OSError):
            os.close(descriptor)


@contextmanager
def open_folder_replacement(path: Path, kind: str) -> Iterator[FolderReplacement]:
    """Yield a `FolderReplacement`; when the block ends, its folder replaces the one at the path.

    Raises:
        ForeignFileOrFolder: If the path holds something that must not be replaced.
        OSError: If the new folder cannot be written. The old folder is unchanged in this case.
    """
    replacement = FolderReplacement(path, kind)
    replacement.start()
    try:
        yield replacement
        replacement.commit()
    finally:
        replacement.abandon()


def check_file_replaceable(path: Path, may_replace: Callable[[Path], bool] | None = None) -> None:
    """Check that a path is free or holds a regular file that may be replaced.

    Raises:
        ForeignFileOrFolder: If the path holds anything else; the message names it.
    """
    path = path.resolve()
    if not os.path.lexists(path):
        return
    if not path.is_file():
        raise ForeignFileOrFolder(f"{path} is no regular file: it is not replaced")
    if may_replace is not None and not may_replace(path):
        raise ForeignFileOrFolder(
            f"{path} is there, and was not written by pw_elements: it is not replaced. Move it "
            "away, or give another name"
        )


def check_folder_replaceable(path: Path, kind: str) -> None:
    """Check that a folder may be created or replaced at a path.

    The path has to be free, or hold an empty folder, or a folder of the same kind that contains
    only the entries listed in its mark.

    Raises:
        ForeignFileOrFolder: If the path holds anything else; the message names it.
    """
    path = path.resolve()
    if not os.path.lexists(path):
        return
    if not path.is_dir():
        raise ForeignFileOrFolder(f"{path} is there and is no folder: it is not replaced")
    content = _list_relative_paths(path)
    mark = _read_folder_mark(path)
    if not mark and not content:
        return
    if mark.get("kind") != kind or not isinstance(mark.get("entries"), list):
        raise ForeignFileOrFolder(
            f"{path} is there, and does not say that it is {kind} of pw_elements: it is not "
            "replaced. Move it away, or give another name"
        )
    if foreign := sorted(content - {*mark["entries"]}):
        raise ForeignFileOrFolder(
            f"{path} is not replaced: it holds {_format_first_names(foreign)}, not written with "
            "it. Move "
            "that away, or give another name"
        )


def create_or_claim_folder(
    path: Path, kind: str, may_mark_existing: Callable[[Path], bool] = lambda _: False
) -> None:
    """Create a marked folder for files that are replaced one by one, or accept an existing one.

    Args:
        path: Path of the folder. Missing parent folders are created.
        kind: Description of the folder, which is stored in its mark.
        may_mark_existing: Function that returns whether an existing folder without a mark may be
            marked. Empty folders are always marked.

    Raises:
        ForeignFileOrFolder: If the path holds something else.
        OSError: If the folder cannot be created.
    """
    path.mkdir(parents=True, exist_ok=True)
    mark = _read_folder_mark(path)
    if mark.get("kind") == kind:
        return
    if mark or (_list_relative_paths(path) and not may_mark_existing(path)):
        raise ForeignFileOrFolder(
            f"{path} is not empty, and does not say that it is {kind} of pw_elements: name a new "
            "folder, or an empty one"
        )
    replace_file_atomically(path / FOLDER_MARK_FILE_NAME, _encode_folder_mark(kind, None))


def remove_files_of_killed_processes(folder: Path) -> None:
    """Remove files and folders that killed processes have left unfinished in a folder.

    If a process was killed while it was replacing a folder, the old folder is restored. Files that
    cannot be removed, or that belong to another user, are kept.
    """
    try:
        with os.scandir(folder) as entries:
            unfinished = [
                Path(entry.path)
                for entry in entries
                if _UNFINISHED_NAME_PATTERN.fullmatch(entry.name)
            ]
    except OSError:  # the caller meets the same error when it writes
        return
    for path in unfinished:
        with suppress(OSError):
            _remove_unless_locked(path)


def _remove_unless_locked(path: Path) -> None:
    """Remove an unfinished file or folder; raise OSError if a process holds its lock."""
    status = os.lstat(path)
    if status.st_uid != os.geteuid():
        return
    if path.is_symlink() or not (path.is_dir() or path.is_file()):
        return
    locked_file = path
    if path.is_dir():
        with suppress(OSError):
            os.rmdir(path)  # its process was killed before it wrote the mark
            return
        locked_file = path / FOLDER_MARK_FILE_NAME
    descriptor = os.open(locked_file, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.is_dir():
            _restore_replaced_folder(path)
            _remove_temporary_folder(path)
        else:
            os.unlink(path)
    finally:
        os.close(descriptor)


@contextmanager
def _name_final_path_in_errors(final_path: Path) -> Iterator[None]:
    """Replace the name of a temporary file in an OSError by the path of the final file."""
    try:
        yield
    except OSError as error:
        if error.errno is None or (
            error.filename and _UNFINISHED_SUFFIX not in str(error.filename)
        ):
            raise
        raise OSError(error.errno, error.strerror, str(final_path)) from error


def _create_locked_temporary_file(folder: Path) -> tuple[Path, int]:
    """Create an unfinished file in a folder; return its path and its locked descriptor."""
    for _ in range(_MAX_CREATION_ATTEMPTS):
        path = folder / f".{secrets.token_hex(8)}{_UNFINISHED_SUFFIX}"
        descriptor = _create_and_lock_file(path)
        if descriptor is not None:
            return path, descriptor
    raise _removed_too_often_error(folder)


def _create_locked_temporary_folder(final_path: Path) -> tuple[Path, int]:
    """Create an unfinished folder beside a path; return it and its mark's locked descriptor."""
    for _ in range(_MAX_CREATION_ATTEMPTS):
        container = final_path.with_name(f".{secrets.token_hex(8)}{_UNFINISHED_SUFFIX}")
        os.mkdir(container)
        try:
            descriptor = _create_and_lock_file(container / FOLDER_MARK_FILE_NAME)
        except FileNotFoundError:  # another process has removed the folder
            continue
        except BaseException:
            with suppress(OSError):
                os.rmdir(container)
            raise
        if descriptor is None:
            continue
        try:
            _write_all(
                descriptor, _encode_folder_mark(_TEMPORARY_FOLDER_KIND, None, final_path.name)
            )
        except BaseException:
            with suppress(OSError):
                _remove_temporary_folder(container)
            os.close(descriptor)
            raise
        return container, descriptor
    raise _removed_too_often_error(final_path.parent)


def _removed_too_often_error(folder: Path) -> OSError:
    return OSError(errno.EAGAIN, "another process removes what this one makes", str(folder))


def _create_and_lock_file(path: Path) -> int | None:
    """Create and lock a file; return its descriptor, or None if another process has removed it."""
    descriptor = _create_new_file(path)
    try:
        if _try_lock_new_file(descriptor):
            return descriptor
    except BaseException:
        with suppress(OSError):
            os.unlink(path)
        os.close(descriptor)
        raise
    os.close(descriptor)
    return None


def _create_new_file(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)


def _try_lock_new_file(descriptor: int) -> bool:
    """Lock a new file; return whether this succeeded before another process locked or removed it.

    Also return True on file systems without locks.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # on file systems without locks, unfinished files are kept
        return True
    return os.fstat(descriptor).st_nlink > 0


def _write_all(descriptor: int, content: bytes) -> None:
    while content:
        content = content[os.write(descriptor, content) :]


def _sync_file(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _exchange_folders(first: Path, second: Path) -> bool:
    """Exchange two folders atomically; return False if the system cannot."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    encoded_paths = os.fsencode(first), os.fsencode(second)
    if not rename(_AT_FDCWD, encoded_paths[0], _AT_FDCWD, encoded_paths[1], _RENAME_EXCHANGE):
        return True
    error_number = ctypes.get_errno()
    if error_number in _EXCHANGE_UNSUPPORTED_ERROR_NUMBERS:
        return False
    raise OSError(error_number, os.strerror(error_number), str(second))


def _restore_replaced_folder(temporary_folder: Path) -> None:
    """Restore the old folder of an interrupted replacement, if its path is free."""
    name, replaced = (
        _read_folder_mark(temporary_folder).get("place"),
        temporary_folder / _REPLACED_FOLDER_NAME,
    )
    if isinstance(name, str) and name and os.path.lexists(replaced):
        target = temporary_folder.with_name(name)
        if not os.path.lexists(target):
            os.rename(replaced, target)


def _remove_temporary_folder(temporary_folder: Path) -> None:
    """Remove an unfinished folder and the folders in it.

    If a folder in it has a mark that lists entries, only these entries of that folder are removed.
    """
    with os.scandir(temporary_folder) as entries:
        paths = [Path(entry.path) for entry in entries if entry.name != FOLDER_MARK_FILE_NAME]
    for path in paths:
        if path.is_symlink() or not path.is_dir():
            os.unlink(path)
        elif isinstance(listed := _read_folder_mark(path).get("entries"), list):
            _remove_marked_folder(path, listed)
        else:
            shutil.rmtree(path)
    os.unlink(temporary_folder / FOLDER_MARK_FILE_NAME)
    os.rmdir(temporary_folder)


def _remove_marked_folder(folder: Path, listed_entries: list[str]) -> None:
    """Remove the listed entries of a folder, then the folder; raise OSError if it is not empty."""
    for entry in sorted(
        _list_relative_paths(folder) & {*listed_entries}, reverse=True
    ):  # the content of a folder before the folder
        (os.rmdir if entry.endswith("/") else os.unlink)(folder / entry)
    if not _list_relative_paths(folder):
        remove_file_if_present(folder / FOLDER_MARK_FILE_NAME)
    os.rmdir(folder)


def _list_relative_paths(folder: Path, prefix: str = "") -> set[str]:
    """Return the relative paths of a folder's content, except its mark.

    Paths of sub-folders end with a slash. Unfinished files are left out.
    """
    relative_paths = set()
    with os.scandir(folder) as entries:
        for entry in entries:
            relative_path = f"{prefix}{entry.name}"
            if entry.is_dir(follow_symlinks=False):
                relative_paths |= {f"{relative_path}/"} | _list_relative_paths(
                    Path(entry.path), f"{relative_path}/"
                )
            elif relative_path != FOLDER_MARK_FILE_NAME and not _UNFINISHED_NAME_PATTERN.fullmatch(
                relative_path
            ):
                relative_paths.add(relative_path)
    return relative_paths


def _encode_folder_mark(kind: str, entries: list[str] | None, target_name: str = "") -> bytes:
    """Return the content of a mark, as JSON."""
    mark = {"made by": _MARK_CREATOR_NAME, "kind": kind, "entries": entries, "place": target_name}
    return (json.dumps(mark, indent=1) + "\n").encode()


def _write_folder_mark(folder: Path, kind: str, entries: list[str]) -> None:
    descriptor = _create_new_file(folder / FOLDER_MARK_FILE_NAME)
    try:
        _write_all(descriptor, _encode_folder_mark(kind, entries))
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _read_folder_mark(folder: Path) -> dict[str, Any]:
    """Return the mark of a folder as a mapping.

    The mapping is empty if the folder has no mark. If the library did not write the mark, "kind" is
    the only key, with the value None.
    """
    try:
        mark = json.loads((folder / FOLDER_MARK_FILE_NAME).read_bytes())
    except FileNotFoundError:
        return {}
    except (ValueError, RecursionError):
        return {"kind": None}
    is_ours = isinstance(mark, dict) and mark.get("made by") == _MARK_CREATOR_NAME
    return mark if is_ours else {"kind": None}


def _format_first_names(names: list[str]) -> str:
    n_more = len(names) - _MAX_NAMES_IN_MESSAGE
    return ", ".join(names[:_MAX_NAMES_IN_MESSAGE]) + (f" and {n_more} more" if n_more > 0 else "")
