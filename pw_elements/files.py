"""Files and folders that are replaced whole, and the mark without which nothing is deleted.

All that the library and the study create, replace and delete goes through here.

- A file is written under another name beside its place, and renamed. It is the old one or the new
  one at any moment, and the old one if anything fails.
- A folder is written beside its place, too, and both are exchanged. A folder that is there is
  replaced only if its mark, a file named ".pw-elements", lists all that it holds.
- What a killed process has left unfinished is removed when another one writes beside it. Its name
  ends in ".pw-elements-unfinished". Whoever writes there holds a lock, which ends with the process,
  so that what others are writing, in other containers too, is left alone. File systems without
  locks keep such remains.

Where the system cannot exchange two folders (some network file systems), a process killed between
two renames leaves no folder in the place. The next process that writes there puts the old one back.
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

MARK_NAME = ".pw-elements"

_MADE_BY = "pw_elements"
_UNFINISHED = ".pw-elements-unfinished"
_UNFINISHED_NAME = re.compile(rf"\.[0-9a-f]{{16}}{re.escape(_UNFINISHED)}")
# Where a folder that is being replaced waits, where the system cannot exchange two
_REPLACED = ".replaced"
_SCRATCH = ".scratch"
_PLACE = "unfinished"  # kind of a folder in which another one is made
_ATTEMPTS = 10  # to make a file that nobody takes for remains before it is locked
_NAMED = 3  # foreign files that an error names
# renameat2(2) of Linux
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2
_NO_EXCHANGE = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)


class ForeignEntry(FileExistsError):
    """A file or folder is in the way that does not carry the mark of what would replace it."""


@contextmanager
def replacing_file(
    path: Path, is_ours: Callable[[Path], bool] | None = None
) -> Iterator[IO[bytes]]:
    """Open a file that takes the place of another one, or makes it, when the block ends.

    Args:
        path: Of the file; of a link, its end is replaced. The folder has to be there.
        is_ours: Whether an existing file may be replaced; without it, any regular file may be.

    Raises:
        ForeignEntry: If something else is there.
        OSError: If it cannot be written; what was there is as it was.
    """
    path = path.resolve()
    check_file_replaceable(path, is_ours)
    remove_unfinished(path.parent)
    with _naming(path):
        temporary, descriptor = _create_locked(path.parent)
        try:
            with os.fdopen(descriptor, "wb") as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
                check_file_replaceable(path, is_ours)
                os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise


def replace_file(path: Path, content: bytes, is_ours: Callable[[Path], bool] | None = None) -> None:
    """Write a file whole or not at all, see `replacing_file`."""
    with replacing_file(path, is_ours) as stream:
        stream.write(content)


def remove_file(path: Path) -> None:
    """Remove a file of the project, if it is there."""
    with suppress(FileNotFoundError):
        os.unlink(path)


class FolderReplacement:
    """A folder that takes the place of another one, or makes it.

    `start`, fill `folder`, and `commit`, on one process; `abandon` removes what has not been
    committed. `replacing_folder` does all three.

    Args:
        path: Of the folder; of a link, its end is replaced. The folder around it has to be there.
        kind: What it is, as "a site"; a folder of another kind is not replaced.
        durable: Whether a loss of power must not cost the content, which takes time for each file.

    Attributes:
        folder: What to fill, of the same name.
        scratch: A folder for what is needed meanwhile.
    """

    def __init__(self, path: Path, kind: str, durable: bool = False) -> None:
        self.path, self.kind, self.durable = path.resolve(), kind, durable
        self._container: tuple[Path, int] | None = None

    def start(self) -> None:
        """Make the folder to be filled.

        Raises:
            ForeignEntry: If something is in the place that is not to be replaced.
            OSError: If nothing can be written there.
        """
        check_folder_replaceable(self.path, self.kind)
        remove_unfinished(self.path.parent)
        with _naming(self.path):
            self._container = _make_container(self.path)
            container, _ = self._container
            self.folder, self.scratch = container / self.path.name, container / _SCRATCH
            try:
                for folder in (self.folder, self.scratch):
                    os.mkdir(folder)
            except BaseException:
                self.abandon()
                raise

    def commit(self) -> None:
        """Put the folder in its place, and delete the one that was there.

        Raises:
            ForeignEntry: If something has been put there meanwhile that is not to be replaced.
            OSError: If the folder cannot be put there; what was there is as it was.
        """
        with _naming(self.path):
            entries = sorted(_entries(self.folder))
            if self.durable:
                for entry in entries:
                    _sync(self.folder / entry)
            _write_mark(self.folder, self.kind, entries)
            check_folder_replaceable(self.path, self.kind)
            if os.path.lexists(self.path) and not _entries(self.path):
                _remove_finished(self.path, [])  # an exchange might take along what comes now
            if not os.path.lexists(self.path):
                os.rename(self.folder, self.path)
            else:
                self._exchange()
        self.abandon()

    def _exchange(self) -> None:
        replaced = self.folder
        if not _exchange(self.folder, self.path):
            replaced = self.folder.with_name(_REPLACED)
            os.rename(self.path, replaced)
            try:
                os.rename(self.folder, self.path)
            except BaseException:
                os.rename(replaced, self.path)
                raise
        try:
            check_folder_replaceable(replaced, self.kind)
        except BaseException:  # something has come since the last look, perhaps
            if replaced == self.folder:
                _exchange(self.folder, self.path)
            else:
                os.rename(self.path, self.folder)
                os.rename(replaced, self.path)
            raise

    def abandon(self) -> None:
        """Remove what has not been put in its place; what cannot be is removed by a later call."""
        if self._container is None:
            return
        container, descriptor = self._container
        self._container = None
        with suppress(OSError):
            _remove_container(container)
        with suppress(OSError):
            os.close(descriptor)


@contextmanager
def replacing_folder(path: Path, kind: str) -> Iterator[FolderReplacement]:
    """Give a folder to fill, which takes the place of another one when the block ends.

    Raises:
        ForeignEntry: If something is in the place that is not to be replaced.
        OSError: If it cannot be written; what was there is as it was.
    """
    replacement = FolderReplacement(path, kind)
    replacement.start()
    try:
        yield replacement
        replacement.commit()
    finally:
        replacement.abandon()


def check_file_replaceable(path: Path, is_ours: Callable[[Path], bool] | None = None) -> None:
    """Refuse to replace what is no regular file, or none of ours.

    Raises:
        ForeignEntry: Says what is in the way.
    """
    path = path.resolve()
    if not os.path.lexists(path):
        return
    if not path.is_file():
        raise ForeignEntry(f"{path} is no regular file: it is not replaced")
    if is_ours is not None and not is_ours(path):
        raise ForeignEntry(
            f"{path} is there, and was not written by pw_elements: it is not replaced. Move it "
            "away, or give another name"
        )


def check_folder_replaceable(path: Path, kind: str) -> None:
    """Refuse to replace what is not a folder of this kind with nothing foreign in it.

    What is not there, and an empty folder, may be replaced.

    Raises:
        ForeignEntry: Says what is in the way.
    """
    path = path.resolve()
    if not os.path.lexists(path):
        return
    if not path.is_dir():
        raise ForeignEntry(f"{path} is there and is no folder: it is not replaced")
    content = _entries(path)
    mark = _read_mark(path)
    if not mark and not content:
        return
    if mark.get("kind") != kind or not isinstance(mark.get("entries"), list):
        raise ForeignEntry(
            f"{path} is there, and does not say that it is {kind} of pw_elements: it is not "
            "replaced. Move it away, or give another name"
        )
    if foreign := sorted(content - {*mark["entries"]}):
        raise ForeignEntry(
            f"{path} is not replaced: it holds {_listed(foreign)}, not written with it. Move that "
            "away, or give another name"
        )


def claim_folder(
    path: Path, kind: str, may_adopt: Callable[[Path], bool] = lambda _: False
) -> None:
    """Make a folder whose content is replaced piece by piece, or find that it is one already.

    Args:
        path: Of the folder, which is made with all around it.
        kind: What it is.
        may_adopt: Tells whether a folder without a mark is one, too; an empty one is.

    Raises:
        ForeignEntry: If something else is there.
        OSError: If it cannot be made.
    """
    path.mkdir(parents=True, exist_ok=True)
    mark = _read_mark(path)
    if mark.get("kind") == kind:
        return
    if mark or (_entries(path) and not may_adopt(path)):
        raise ForeignEntry(
            f"{path} is not empty, and does not say that it is {kind} of pw_elements: name a new "
            "folder, or an empty one"
        )
    replace_file(path / MARK_NAME, _mark(kind, None))


def remove_unfinished(folder: Path) -> None:
    """Remove what killed processes have left unfinished in a folder, and nothing else.

    Of a folder that was about to be replaced, the old one is put back. What cannot be removed, or
    is another user's, stays.
    """
    try:
        with os.scandir(folder) as entries:
            remains = [Path(one.path) for one in entries if _UNFINISHED_NAME.fullmatch(one.name)]
    except OSError:  # whoever writes there will say so
        return
    for path in remains:
        with suppress(OSError):
            _sweep(path)


def _sweep(path: Path) -> None:
    state = os.lstat(path)
    if state.st_uid != os.geteuid():
        return
    if path.is_symlink() or not (path.is_dir() or path.is_file()):
        return
    lock = path
    if path.is_dir():
        with suppress(OSError):
            os.rmdir(path)  # of a process that was killed before it made the mark
            return
        lock = path / MARK_NAME
    descriptor = os.open(lock, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.is_dir():
            _put_back(path)
            _remove_container(path)
        else:
            os.unlink(path)
    finally:
        os.close(descriptor)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Have errors of unfinished files name the path that was to be written."""
    try:
        yield
    except OSError as error:
        if error.errno is None or (error.filename and _UNFINISHED not in str(error.filename)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def _create_locked(folder: Path) -> tuple[Path, int]:
    """Make an unfinished file in a folder; return it with its descriptor, which holds a lock."""
    for _ in range(_ATTEMPTS):
        path = folder / f".{secrets.token_hex(8)}{_UNFINISHED}"
        descriptor = _open_new(path)
        try:
            if _lock(descriptor):
                return path, descriptor
        except BaseException:
            with suppress(OSError):
                os.unlink(path)
            os.close(descriptor)
            raise
        os.close(descriptor)
    raise OSError(errno.EAGAIN, "another process removes what this one makes", str(folder))


def _make_container(path: Path) -> tuple[Path, int]:
    """Make an unfinished folder beside a path; return it with its mark, which is locked."""
    for _ in range(_ATTEMPTS):
        container = path.with_name(f".{secrets.token_hex(8)}{_UNFINISHED}")
        os.mkdir(container)
        try:
            descriptor = _open_new(container / MARK_NAME)
        except FileNotFoundError:  # taken for remains
            continue
        except BaseException:
            with suppress(OSError):
                os.rmdir(container)
            raise
        try:
            if _lock(descriptor):
                _write_all(descriptor, _mark(_PLACE, None, path.name))
                return container, descriptor
        except BaseException:
            with suppress(OSError):
                _remove_container(container)
            os.close(descriptor)
            raise
        os.close(descriptor)
    raise OSError(errno.EAGAIN, "another process removes what this one makes", str(path.parent))


def _open_new(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)


def _lock(descriptor: int) -> bool:
    """Lock a new file; return False if another process has taken it for remains."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks, on which nobody sweeps
        return True
    return os.fstat(descriptor).st_nlink > 0


def _write_all(descriptor: int, content: bytes) -> None:
    while content:
        content = content[os.write(descriptor, content) :]


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two folders at once; False where the system cannot."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    names = os.fsencode(one), os.fsencode(other)
    if not rename(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE):
        return True
    number = ctypes.get_errno()
    if number in _NO_EXCHANGE:
        return False
    raise OSError(number, os.strerror(number), str(other))


def _put_back(container: Path) -> None:
    """Put a folder back that was about to be replaced, if nothing has come into its place."""
    name, replaced = _read_mark(container).get("place"), container / _REPLACED
    if isinstance(name, str) and name and os.path.lexists(replaced):
        place = container.with_name(name)
        if not os.path.lexists(place):
            os.rename(replaced, place)


def _remove_container(container: Path) -> None:
    """Remove an unfinished folder: of a finished one in it, no more than its mark lists."""
    with os.scandir(container) as entries:
        paths = [Path(entry.path) for entry in entries if entry.name != MARK_NAME]
    for path in paths:
        if path.is_symlink() or not path.is_dir():
            os.unlink(path)
        elif isinstance(listed := _read_mark(path).get("entries"), list):
            _remove_finished(path, listed)
        else:
            shutil.rmtree(path)
    os.unlink(container / MARK_NAME)
    os.rmdir(container)


def _remove_finished(folder: Path, listed: list[str]) -> None:
    """Remove a folder as its mark lists it; raise OSError if something foreign is in it."""
    for entry in sorted(_entries(folder) & {*listed}, reverse=True):  # what is in a folder first
        (os.rmdir if entry.endswith("/") else os.unlink)(folder / entry)
    if not _entries(folder):
        remove_file(folder / MARK_NAME)
    os.rmdir(folder)


def _entries(folder: Path, within: str = "") -> set[str]:
    """Return all that a folder holds but its mark, by relative names; folders end in a slash."""
    found = set()
    with os.scandir(folder) as entries:
        for entry in entries:
            name = f"{within}{entry.name}"
            if entry.is_dir(follow_symlinks=False):
                found |= {f"{name}/"} | _entries(Path(entry.path), f"{name}/")
            elif name != MARK_NAME and not _UNFINISHED_NAME.fullmatch(name):
                found.add(name)
    return found


def _mark(kind: str, entries: list[str] | None, place: str = "") -> bytes:
    mark = {"made by": _MADE_BY, "kind": kind, "entries": entries, "place": place}
    return (json.dumps(mark, indent=1) + "\n").encode()


def _write_mark(folder: Path, kind: str, entries: list[str]) -> None:
    descriptor = _open_new(folder / MARK_NAME)
    try:
        _write_all(descriptor, _mark(kind, entries))
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _read_mark(folder: Path) -> dict[str, Any]:
    """Return a folder's mark: an empty one if it has none, one of no kind if it is not ours."""
    try:
        mark = json.loads((folder / MARK_NAME).read_bytes())
    except FileNotFoundError:
        return {}
    except (ValueError, RecursionError):
        return {"kind": None}
    ours = isinstance(mark, dict) and mark.get("made by") == _MADE_BY
    return mark if ours else {"kind": None}


def _listed(names: list[str]) -> str:
    rest = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {rest} more" if rest > 0 else "")
