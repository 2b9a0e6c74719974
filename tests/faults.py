"""Faults at each system call of operations on files: an error, or the end of the process.

`run_with_failing_call(operation, number, error)` lets the system call with the given number fail.
`python3 -m tests.faults` kills a process before and after each system call of the cases below, and
checks the remaining files.
"""

import errno
import fcntl
import os
import sys
import tempfile
import traceback
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest.mock import patch

import numpy as np

from study.run.store import CorruptResult, MissingResult, Result, Results, save

# `study.run.store` has loaded this module without the solver, which would make forks slow
files = sys.modules["pw_elements.files"]

SYSTEM_CALLS = (
    "open", "write", "fsync", "close", "replace", "rename", "mkdir", "unlink", "rmdir", "scandir",
    "lstat", "stat", "fstat",
)  # fmt: skip
ERROR_NUMBERS = (errno.ENOSPC, errno.EACCES, errno.EIO)
FOLDER_KIND = "a folder of this test"
OLD_CONTENT, NEW_CONTENT = b"old" * 5000, b"new" * 6000


class CallCounter:
    """Counter of the system calls in a `with` block; it replaces the call with a given number."""

    def __init__(self, call_number, replacement_call):
        self.call_number, self.replacement_call, self.n_calls, self.called_names = (
            call_number,
            replacement_call,
            0,
            [],
        )

    def __call__(self, function):
        def count_and_call(*args, **kwargs):
            self.n_calls += 1
            self.called_names.append(function.__name__)
            if self.n_calls == self.call_number:
                return self.replacement_call(lambda: function(*args, **kwargs))
            return function(*args, **kwargs)

        return count_and_call

    @contextmanager
    def count_calls(self):
        exchange_folders, fdopen = files._exchange_folders, os.fdopen
        patches = [patch.object(os, name, self(getattr(os, name))) for name in SYSTEM_CALLS]
        patches.append(patch.object(fcntl, "flock", self(fcntl.flock)))
        patches.append(patch.object(files, "_exchange_folders", self(exchange_folders)))
        patches.append(
            patch.object(os, "fdopen", lambda *args: CountingStream(fdopen(*args), self))
        )
        for patcher in patches:
            patcher.start()
        try:
            yield self
        finally:
            for patcher in patches:
                patcher.stop()


class CountingStream:
    """File whose writes and flushes count as system calls."""

    def __init__(self, stream, counter):
        self._stream = stream
        self.write, self.flush = counter(stream.write), counter(stream.flush)

    def __getattr__(self, name):
        return getattr(self._stream, name)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stream.close()


def run_with_failing_call(operation, call_number, error_number):
    """Run an operation whose system call number `call_number` fails.

    Returns:
        Whether the call was reached, and the error raised by the operation or None.
    """

    def raise_error(call):
        if counter.called_names[-1] == "close":  # a failing close() still closes
            call()
        raise OSError(error_number, os.strerror(error_number))

    error_raised = None
    counter = CallCounter(call_number, raise_error)
    with counter.count_calls():
        try:
            operation()
        except Exception as exception:
            error_raised = exception
    return counter.n_calls >= call_number, error_raised


def run_and_kill_at_call(operation, call_number, after_call):
    """Run an operation in a child process to be killed at a call; return whether it was killed."""

    def kill(call):
        with suppress(OSError):
            if after_call:
                call()
        os._exit(9)

    process = os.fork()
    if not process:
        try:
            with CallCounter(call_number, kill).count_calls():
                operation()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    _, status = os.waitpid(process, 0)
    exit_code = os.waitstatus_to_exitcode(status)
    assert exit_code in (0, 9)
    return exit_code == 9


class FileReplacementCase:
    """Replacement of a file."""

    def prepare(self, folder):
        files.replace_file_atomically(folder / "data", OLD_CONTENT)

    def replace(self, folder):
        files.replace_file_atomically(folder / "data", NEW_CONTENT)

    def inspect_state(self, folder):
        return {OLD_CONTENT: "old", NEW_CONTENT: "new"}[(folder / "data").read_bytes()]


class FolderReplacementCase:
    """Replacement of a folder."""

    def write_folder(self, folder, content):
        with files.open_folder_replacement(folder / "made", FOLDER_KIND) as replacement:
            (replacement.scratch / "more").write_text("not kept")
            (replacement.folder / "one").write_bytes(content)
            (replacement.folder / content[:3].decode()).mkdir()
            (replacement.folder / content[:3].decode() / "deep").write_bytes(content)

    def prepare(self, folder):
        self.write_folder(folder, OLD_CONTENT)

    def replace(self, folder):
        self.write_folder(folder, NEW_CONTENT)

    def inspect_state(self, folder):
        target = folder / "made"
        if not target.exists():
            return "missing"
        state = {OLD_CONTENT: "old", NEW_CONTENT: "new"}[(target / "one").read_bytes()]
        names = {str(path.relative_to(target)) for path in target.rglob("*")}
        assert names == {files.FOLDER_MARK_FILE_NAME, "one", state, f"{state}/deep"}, names
        assert (target / state / "deep").read_bytes() == (target / "one").read_bytes()
        return state


class FolderCreationCase(FolderReplacementCase):
    """Creation of a folder."""

    def prepare(self, folder):
        pass


class EmptyFolderReplacementCase(FolderReplacementCase):
    """Replacement of an empty folder of the user."""

    def prepare(self, folder):
        (folder / "made").mkdir()

    def inspect_state(self, folder):
        is_empty = (folder / "made").exists() and not any((folder / "made").iterdir())
        return "missing" if is_empty else super().inspect_state(folder)


class FolderWithoutExchangeCase(FolderReplacementCase):
    """Replacement of a folder on a system that lacks renameat2."""

    def replace(self, folder):
        with patch.object(files.ctypes, "CDLL", lambda *_, **__: object()):
            super().replace(folder)


class FolderClaimCase:
    """Claim of a folder whose files are replaced one by one."""

    def prepare(self, folder):
        pass

    def replace(self, folder):
        files.create_or_claim_folder(folder / "made", FOLDER_KIND)

    def inspect_state(self, folder):
        target = folder / "made"
        if not target.exists():
            return "missing"
        names = [path.name for path in target.iterdir()]
        return "new" if names == [files.FOLDER_MARK_FILE_NAME] else "missing"


class ResultReplacementCase:
    """Replacement of a study result, whose numbers and curves are stored in two files."""

    def save_result(self, folder, value):
        result = Result({"y": value}, {"y": "1"}, {"x": np.full(300, value)})
        save(folder / "made", "7.1", "pw-T6", result, {"problem": "toy"}, {})

    def prepare(self, folder):
        self.save_result(folder, 1.0)

    def replace(self, folder):
        files.remove_files_of_killed_processes(folder / "made" / "7.1")
        self.save_result(folder, 2.0)

    def inspect_state(self, folder):
        try:
            stored = Results(folder / "made")["7.1/pw-T6"]
        except MissingResult:
            return "missing"
        except CorruptResult as error:
            assert "not of the same run" in str(error)  # noqa: PT017
            return "mixed, and known to be"
        assert {*stored.curves["x"]} == {stored.scalars["y"]}
        return {1.0: "old", 2.0: "new"}[stored.scalars["y"]]


REPLACEMENT_CASES = {
    case.__name__: case()
    for case in (
        FileReplacementCase,
        FolderReplacementCase,
        FolderCreationCase,
        EmptyFolderReplacementCase,
        FolderWithoutExchangeCase,
        FolderClaimCase,
        ResultReplacementCase,
    )
}
# Allowed states besides old and new content (without renameat2, only until the next call)
ALLOWED_STATES = {
    "FolderCreationCase": {"missing"},
    "EmptyFolderReplacementCase": {"missing"},
    "FolderWithoutExchangeCase": {"missing"},
    "FolderClaimCase": {"missing"},
    "ResultReplacementCase": {"mixed, and known to be"},
}
RESTORED_CASES = {"FolderWithoutExchangeCase"}


@contextmanager
def folder_with_user_files():
    """Yield a folder with files of the user; afterwards, check that they are unchanged."""
    with tempfile.TemporaryDirectory() as temporary_folder:
        outside_folder, folder = (
            Path(temporary_folder) / "outside",
            Path(temporary_folder) / "folder",
        )
        for path in (outside_folder / "file", folder / "notes.txt", folder / "other.bp" / "md.idx"):
            path.parent.mkdir(exist_ok=True)
            path.write_text("mine")
        (folder / ".0123456789abcdef.pw-elements-unfinished.txt").write_text("mine")
        (folder / "link").symlink_to(outside_folder)
        (folder / ".aaaaaaaaaaaaaaaa.pw-elements-unfinished").symlink_to(outside_folder)
        content_before = folder_content(Path(temporary_folder))
        yield folder
        content_after = folder_content(Path(temporary_folder))
        assert {path: content_after.get(path) for path in content_before} == content_before
        new_entries = {path.split("/")[1] for path in content_after.keys() - content_before.keys()}
        assert new_entries <= {"made", "data"}, new_entries


def folder_content(folder):
    return {
        str(path.relative_to(folder)): path.is_file() and path.read_bytes()
        for path in folder.rglob("*")
    }


def check_recovery(case, folder, error_raised=None):
    """Check the state after a fault and that the next operation succeeds; return the state."""
    name = type(case).__name__
    state = case.inspect_state(folder)
    assert state in {"old", "new"} | ALLOWED_STATES.get(name, set()), state
    if error_raised is not None and name not in ALLOWED_STATES:
        assert state == "old", state
    if name in RESTORED_CASES and state == "missing":
        files.remove_files_of_killed_processes(folder)
        assert case.inspect_state(folder) == "old"
    case.replace(folder)
    assert case.inspect_state(folder) == "new"
    return state


def kill_at_each_call(case):
    """Kill a case's operation at each system call; return the number of kills and the states."""
    states, call_number, was_killed = [], 0, True
    while was_killed:
        call_number += 1
        for after_call in (False, True):
            with folder_with_user_files() as folder:
                case.prepare(folder)
                was_killed = run_and_kill_at_call(
                    lambda target_folder=folder: case.replace(target_folder),
                    call_number,
                    after_call,
                )
                if was_killed:
                    states.append(check_recovery(case, folder))
    return len(states), {*states}


if __name__ == "__main__":
    for name in sys.argv[1:] or REPLACEMENT_CASES:
        n_kills, states = kill_at_each_call(REPLACEMENT_CASES[name])
        print(f"{name}: killed {n_kills} times, then {', '.join(sorted(states))}")
