"""Replacement of files and folders.

After a failure, the content is either old or new, never mixed. Foreign files are not changed.
"""

import errno
import fcntl
import os
import re
import subprocess
import sys
from itertools import count, cycle
from pathlib import Path

import pytest

from pw_elements import files
from pw_elements.files import (
    FOLDER_MARK_FILE_NAME,
    FolderReplacement,
    ForeignFileOrFolder,
    check_folder_replaceable,
    create_or_claim_folder,
    open_folder_replacement,
    remove_files_of_killed_processes,
    replace_file_atomically,
)
from tests.faults import (
    ERROR_NUMBERS,
    FOLDER_KIND,
    NEW_CONTENT,
    REPLACEMENT_CASES,
    check_recovery,
    folder_with_user_files,
    run_with_failing_call,
)

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", REPLACEMENT_CASES)
def test_a_failing_system_call_leaves_the_old_or_the_new_content_only(name):
    """Each system call of an operation fails once, and the kinds of error take turns.

    The replacement of files and folders does not distinguish these errors.
    """
    case, errors = REPLACEMENT_CASES[name], []
    for number, error in zip(count(1), cycle(ERROR_NUMBERS), strict=False):
        with folder_with_user_files() as folder:
            case.prepare(folder)
            reached, error_raised = run_with_failing_call(
                lambda at=folder: case.replace(at), number, error
            )
            if not reached:
                break
            assert error_raised is None or isinstance(error_raised, OSError), error_raised
            errors.append(error_raised)
            check_recovery(case, folder, error_raised)
    assert number > 15
    assert sum(error_raised is not None for error_raised in errors) > 5


def test_a_kill_leaves_old_or_new_content_and_the_next_replacement_cleans_up():
    command = [sys.executable, "-W", "ignore", "-m", "tests.faults"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    kills_by_case = dict(re.findall(r"^(\w+): killed (\d+) times", run.stdout, re.MULTILINE))
    assert kills_by_case.keys() == REPLACEMENT_CASES.keys()
    assert all(int(n_kills) > 20 for n_kills in kills_by_case.values()), run.stdout


def replace_folder_with_files(path, **text_by_file_name):
    with open_folder_replacement(path, FOLDER_KIND) as replacement:
        for name, text in text_by_file_name.items():
            (replacement.folder / name).write_text(text)


def test_a_folder_is_replaced_if_all_in_it_was_written_with_it(tmp_path):
    path = tmp_path / "made"
    replace_folder_with_files(path, one="1", two="2")
    replace_folder_with_files(path, one="11")
    assert sorted(os.listdir(path)) == [FOLDER_MARK_FILE_NAME, "one"]
    (path / "two").write_text("mine")
    (path / "deep").mkdir()
    with pytest.raises(ForeignFileOrFolder, match="it holds deep/, two, not written with it"):
        replace_folder_with_files(path, one="111")
    assert (path / "two").read_text() == "mine"
    assert (path / "one").read_text() == "11"
    (path / "two").unlink()
    (path / "deep").rmdir()
    (path / "one").unlink()
    (path / "one").mkdir()
    with pytest.raises(ForeignFileOrFolder, match="it holds one/"):
        replace_folder_with_files(path)
    assert os.listdir(tmp_path) == ["made"]


@pytest.mark.parametrize("mark", [None, "", "{", "[]", '{"kind": "K"}', "other kind"])
def test_a_folder_without_the_right_mark_is_not_replaced(tmp_path, mark):
    path = tmp_path / "made"
    if mark == "other kind":
        with open_folder_replacement(path, "something else") as replacement:
            (replacement.folder / "one").write_text("mine")
    else:
        path.mkdir()
        (path / "one").write_text("mine")
        if mark is not None:
            (path / FOLDER_MARK_FILE_NAME).write_text(mark.replace("K", FOLDER_KIND))
    with pytest.raises(ForeignFileOrFolder, match="does not say that it is a folder of this test"):
        replace_folder_with_files(path, one="2")
    with pytest.raises(ForeignFileOrFolder, match="is not empty, and does not say"):
        create_or_claim_folder(path, FOLDER_KIND)
    assert (path / "one").read_text() == "mine"
    assert os.listdir(tmp_path) == ["made"]
    if mark is not None:  # the mark may be the only thing that the user has in the folder
        (path / "one").unlink()
        content = (path / FOLDER_MARK_FILE_NAME).read_text()
        with pytest.raises(ForeignFileOrFolder):
            create_or_claim_folder(path, FOLDER_KIND)
        with pytest.raises(ForeignFileOrFolder):
            replace_folder_with_files(path, one="2")
        assert (path / FOLDER_MARK_FILE_NAME).read_text() == content


def test_a_file_is_not_replaced_by_a_folder_and_links_are_followed(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ForeignFileOrFolder, match="is no folder"):
        replace_folder_with_files(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    link = tmp_path / "link"
    link.symlink_to(elsewhere / "made")
    for text in ("1", "2"):
        replace_folder_with_files(link, one=text)
        assert link.is_symlink()
        assert (elsewhere / "made" / "one").read_text() == text
    (elsewhere / "made" / "two").symlink_to(tmp_path / "file")
    with pytest.raises(ForeignFileOrFolder, match="it holds two"):
        replace_folder_with_files(link, one="3")


def test_files_added_while_a_folder_is_replaced_are_kept(tmp_path):
    path = tmp_path / "made"
    for has_old_folder in (False, True):
        replacement = FolderReplacement(path, FOLDER_KIND)
        replacement.start()
        (replacement.folder / "one").write_text("new")
        path.mkdir(exist_ok=True)
        (path / "late").write_text("mine")
        with pytest.raises(ForeignFileOrFolder, match="not replaced"):
            replacement.commit()
        replacement.abandon()
        assert (path / "late").read_text() == "mine"
        assert os.listdir(tmp_path) == ["made"]
        (path / "late").unlink()
        if not has_old_folder:
            replace_folder_with_files(path, one="old")


@pytest.mark.parametrize("can_exchange", [True, False])
def test_a_file_added_just_before_the_exchange_is_kept(tmp_path, monkeypatch, can_exchange):
    path, exchange_folders = tmp_path / "made", files._exchange_folders
    replace_folder_with_files(path, one="old")

    def add_file_and_exchange(first, second):
        if (path / "one").read_text() == "old":
            (path / "late").write_text("mine")
        return exchange_folders(first, second) if can_exchange else False

    monkeypatch.setattr(files, "_exchange_folders", add_file_and_exchange)
    with pytest.raises(ForeignFileOrFolder, match="it holds late"):
        replace_folder_with_files(path, one="new")
    assert ((path / "one").read_text(), (path / "late").read_text()) == ("old", "mine")
    assert os.listdir(tmp_path) == ["made"]


def test_only_own_and_regular_files_are_replaced(tmp_path):
    path = tmp_path / "file"

    def is_ours(existing):
        return existing.read_bytes().startswith(b"ours")

    replace_file_atomically(path, b"ours", is_ours)
    replace_file_atomically(path, b"mine", is_ours)
    with pytest.raises(ForeignFileOrFolder, match="was not written by pw_elements"):
        replace_file_atomically(path, NEW_CONTENT, is_ours)
    assert path.read_bytes() == b"mine"
    os.mkfifo(tmp_path / "fifo")
    for irregular in (tmp_path / "fifo", tmp_path, Path("/dev/null")):
        with pytest.raises(ForeignFileOrFolder, match="no regular file"):
            replace_file_atomically(irregular, NEW_CONTENT)
    (tmp_path / "link").symlink_to(path)
    replace_file_atomically(tmp_path / "link", NEW_CONTENT)
    assert (tmp_path / "link").is_symlink()
    assert path.read_bytes() == NEW_CONTENT


def test_errors_name_the_target_path(tmp_path):
    for call in (lambda at: replace_file_atomically(at, NEW_CONTENT), replace_folder_with_files):
        with pytest.raises(FileNotFoundError) as raised:
            call(tmp_path / "nowhere" / "made")
        assert raised.value.filename == str(tmp_path / "nowhere" / "made")


def test_claimed_folders_keep_their_mark_and_kind(tmp_path):
    out = tmp_path / "deep" / "out"
    for _ in range(2):
        create_or_claim_folder(out, FOLDER_KIND)
    (out / "mine").write_text("more")
    create_or_claim_folder(out, FOLDER_KIND)
    with pytest.raises(ForeignFileOrFolder):
        create_or_claim_folder(out, "another kind")
    with pytest.raises(ForeignFileOrFolder):  # the folder has no list of its content
        check_folder_replaceable(out, FOLDER_KIND)
    unmarked = tmp_path / "other"
    unmarked.mkdir()
    (unmarked / "mine").write_text("more")
    create_or_claim_folder(unmarked, FOLDER_KIND, lambda folder: (folder / "mine").exists())
    assert sorted(os.listdir(unmarked)) == [FOLDER_MARK_FILE_NAME, "mine"]


UNFINISHED_WRITER_SCRIPT = """
import sys
from pathlib import Path
from pw_elements.files import open_replacement_file, open_folder_replacement
folder = Path(sys.argv[1])
made_folder = open_folder_replacement(folder / "made", "K")
with open_replacement_file(folder / "file") as stream, made_folder as made:
    stream.write(b"begun")
    (made.folder / "one").write_text("begun")
    print("begun", flush=True)
    sys.stdin.read()
"""


def test_unfinished_files_of_killed_but_not_of_live_processes_are_removed(tmp_path):
    command = [sys.executable, "-c", UNFINISHED_WRITER_SCRIPT, str(tmp_path)]
    foreign_names = [
        ".a.json.0123456789abcdef.4.pw-elements-unfinished",
        ".0123456789abcdef.pw-elements-unfinished.txt",
        "0123456789abcdef.pw-elements-unfinished",
    ]
    for name in foreign_names:
        (tmp_path / name).write_text("mine")
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "cwd": ROOT}
    with subprocess.Popen(command, **pipes) as process:
        assert process.stdout.readline() == b"begun\n"
        unfinished = {*os.listdir(tmp_path)} - {*foreign_names}
        assert len(unfinished) == 2
        remove_files_of_killed_processes(tmp_path)
        assert {*os.listdir(tmp_path)} == unfinished | {*foreign_names}
        process.kill()
        process.wait()
        remove_files_of_killed_processes(tmp_path)
        assert {*os.listdir(tmp_path)} == {*foreign_names}


def test_without_file_locks_files_are_written_and_none_removed(tmp_path, monkeypatch):
    def raise_no_locks_error(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    (tmp_path / ".0123456789abcdef.pw-elements-unfinished").write_text("perhaps another's")
    monkeypatch.setattr(fcntl, "flock", raise_no_locks_error)
    replace_file_atomically(tmp_path / "file", NEW_CONTENT)
    replace_folder_with_files(tmp_path / "made", one="1")
    assert len(os.listdir(tmp_path)) == 3
    monkeypatch.undo()
    remove_files_of_killed_processes(tmp_path)
    assert sorted(os.listdir(tmp_path)) == ["file", "made"]


def test_temporary_names_are_unpredictable_and_long_names_work(tmp_path, monkeypatch):
    temporary_names, replace = [], os.replace

    def record_name_and_replace(source, target):
        temporary_names.append(source)
        replace(source, target)

    monkeypatch.setattr(os, "replace", record_name_and_replace)
    for _ in range(2):
        replace_file_atomically(tmp_path / ("n" * 255), NEW_CONTENT)
    assert len({*temporary_names}) == 2
    monkeypatch.setattr("secrets.token_hex", lambda _: "0" * 16)
    (tmp_path / f".{'0' * 16}.pw-elements-unfinished").symlink_to(tmp_path / "foreign")
    with pytest.raises(FileExistsError):
        replace_file_atomically(tmp_path / "file", NEW_CONTENT)
    assert not (tmp_path / "foreign").exists()
