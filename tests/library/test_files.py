"""Replacement of files and folders: content is old or new after failures, never mixed.

Foreign files stay untouched.
"""

import errno
import fcntl
import os
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest

from pw_elements import files
from pw_elements.files import (
    MARK_NAME,
    FolderReplacement,
    ForeignEntry,
    check_folder_replaceable,
    claim_folder,
    remove_unfinished,
    replace_file,
    replacing_folder,
)
from tests.faults import (
    CASES,
    ERROR_NUMBERS,
    FOLDER_KIND,
    NEW_CONTENT,
    check_recovery,
    run_with_failure,
    user_folder,
)

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("error", ERROR_NUMBERS, ids=lambda number: errno.errorcode[number])
@pytest.mark.parametrize("name", CASES)
def test_a_call_that_fails_leaves_the_old_or_the_new_and_nothing_else(name, error):
    case, errors = CASES[name], []
    for number in count(1):
        with user_folder() as folder:
            case.prepare(folder)
            reached, error_raised = run_with_failure(
                lambda at=folder: case.replace(at), number, error
            )
            if not reached:
                break
            assert error_raised is None or isinstance(error_raised, OSError), error_raised
            errors.append(error_raised)
            check_recovery(case, folder, error_raised)
    assert number > 15
    assert sum(error_raised is not None for error_raised in errors) > 5


@pytest.mark.parametrize("name", CASES)
def test_a_kill_at_any_call_leaves_the_old_or_the_new_and_the_next_call_cleans(name):
    command = [sys.executable, "-W", "ignore", "-m", "tests.faults", name]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout.split()[2]) > 20, run.stdout


def make_folder(path, **content):
    with replacing_folder(path, FOLDER_KIND) as replacement:
        for name, text in content.items():
            (replacement.folder / name).write_text(text)


def test_a_folder_is_replaced_if_all_in_it_was_written_with_it(tmp_path):
    path = tmp_path / "made"
    make_folder(path, one="1", two="2")
    make_folder(path, one="11")
    assert sorted(os.listdir(path)) == [MARK_NAME, "one"]
    (path / "two").write_text("mine")
    (path / "deep").mkdir()
    with pytest.raises(ForeignEntry, match="it holds deep/, two, not written with it"):
        make_folder(path, one="111")
    assert (path / "two").read_text() == "mine"
    assert (path / "one").read_text() == "11"
    (path / "two").unlink()
    (path / "deep").rmdir()
    (path / "one").unlink()
    (path / "one").mkdir()
    with pytest.raises(ForeignEntry, match="it holds one/"):
        make_folder(path)
    assert os.listdir(tmp_path) == ["made"]


@pytest.mark.parametrize("mark", [None, "", "{", "[]", '{"kind": "K"}', "other kind"])
def test_a_folder_without_the_right_mark_is_not_replaced(tmp_path, mark):
    path = tmp_path / "made"
    if mark == "other kind":
        with replacing_folder(path, "something else") as replacement:
            (replacement.folder / "one").write_text("mine")
    else:
        path.mkdir()
        (path / "one").write_text("mine")
        if mark is not None:
            (path / MARK_NAME).write_text(mark.replace("K", FOLDER_KIND))
    with pytest.raises(ForeignEntry, match="does not say that it is a folder of this test"):
        make_folder(path, one="2")
    with pytest.raises(ForeignEntry, match="is not empty, and does not say"):
        claim_folder(path, FOLDER_KIND)
    assert (path / "one").read_text() == "mine"
    assert os.listdir(tmp_path) == ["made"]
    if mark is not None:  # the mark may be the only thing that the user has in the folder
        (path / "one").unlink()
        content = (path / MARK_NAME).read_text()
        with pytest.raises(ForeignEntry):
            claim_folder(path, FOLDER_KIND)
        with pytest.raises(ForeignEntry):
            make_folder(path, one="2")
        assert (path / MARK_NAME).read_text() == content


def test_files_and_links_in_the_place_of_a_folder(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ForeignEntry, match="is no folder"):
        make_folder(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    link = tmp_path / "link"
    link.symlink_to(elsewhere / "made")
    for text in ("1", "2"):
        make_folder(link, one=text)
        assert link.is_symlink()
        assert (elsewhere / "made" / "one").read_text() == text
    (elsewhere / "made" / "two").symlink_to(tmp_path / "file")
    with pytest.raises(ForeignEntry, match="it holds two"):
        make_folder(link, one="3")


def test_what_comes_into_a_folder_while_another_one_is_made_is_kept(tmp_path):
    path = tmp_path / "made"
    for has_old_folder in (False, True):
        replacement = FolderReplacement(path, FOLDER_KIND)
        replacement.start()
        (replacement.folder / "one").write_text("new")
        path.mkdir(exist_ok=True)
        (path / "late").write_text("mine")
        with pytest.raises(ForeignEntry, match="not replaced"):
            replacement.commit()
        replacement.abandon()
        assert (path / "late").read_text() == "mine"
        assert os.listdir(tmp_path) == ["made"]
        (path / "late").unlink()
        if not has_old_folder:
            make_folder(path, one="old")


@pytest.mark.parametrize("can_exchange", [True, False])
def test_what_comes_at_the_last_moment_is_kept_too(tmp_path, monkeypatch, can_exchange):
    path, exchange_folders = tmp_path / "made", files._exchange_folders
    make_folder(path, one="old")

    def add_file_and_exchange(first, second):
        if (path / "one").read_text() == "old":
            (path / "late").write_text("mine")
        return exchange_folders(first, second) if can_exchange else False

    monkeypatch.setattr(files, "_exchange_folders", add_file_and_exchange)
    with pytest.raises(ForeignEntry, match="it holds late"):
        make_folder(path, one="new")
    assert ((path / "one").read_text(), (path / "late").read_text()) == ("old", "mine")
    assert os.listdir(tmp_path) == ["made"]


def test_only_files_of_ours_are_replaced_and_no_others_than_regular_ones(tmp_path):
    path = tmp_path / "file"

    def is_ours(existing):
        return existing.read_bytes().startswith(b"ours")

    replace_file(path, b"ours", is_ours)
    replace_file(path, b"mine", is_ours)
    with pytest.raises(ForeignEntry, match="was not written by pw_elements"):
        replace_file(path, NEW_CONTENT, is_ours)
    assert path.read_bytes() == b"mine"
    os.mkfifo(tmp_path / "fifo")
    for irregular in (tmp_path / "fifo", tmp_path, Path("/dev/null")):
        with pytest.raises(ForeignEntry, match="no regular file"):
            replace_file(irregular, NEW_CONTENT)
    (tmp_path / "link").symlink_to(path)
    replace_file(tmp_path / "link", NEW_CONTENT)
    assert (tmp_path / "link").is_symlink()
    assert path.read_bytes() == NEW_CONTENT


def test_errors_name_what_was_to_be_written(tmp_path):
    for call in (lambda at: replace_file(at, NEW_CONTENT), make_folder):
        with pytest.raises(FileNotFoundError) as raised:
            call(tmp_path / "nowhere" / "made")
        assert raised.value.filename == str(tmp_path / "nowhere" / "made")


def test_a_mark_of_a_folder_of_files_outlives_its_own_replacement(tmp_path):
    out = tmp_path / "deep" / "out"
    for _ in range(2):
        claim_folder(out, FOLDER_KIND)
    (out / "mine").write_text("more")
    claim_folder(out, FOLDER_KIND)
    with pytest.raises(ForeignEntry):
        claim_folder(out, "another kind")
    with pytest.raises(ForeignEntry):  # the folder has no list of its content
        check_folder_replaceable(out, FOLDER_KIND)
    unmarked = tmp_path / "other"
    unmarked.mkdir()
    (unmarked / "mine").write_text("more")
    claim_folder(unmarked, FOLDER_KIND, lambda folder: (folder / "mine").exists())
    assert sorted(os.listdir(unmarked)) == [MARK_NAME, "mine"]


WRITER_SCRIPT = """
import sys
from pathlib import Path
from pw_elements.files import replacing_file, replacing_folder
folder = Path(sys.argv[1])
with replacing_file(folder / "file") as stream, replacing_folder(folder / "made", "K") as made:
    stream.write(b"begun")
    (made.folder / "one").write_text("begun")
    print("begun", flush=True)
    sys.stdin.read()
"""


def test_what_live_processes_write_is_not_swept_and_what_killed_ones_left_is(tmp_path):
    command = [sys.executable, "-c", WRITER_SCRIPT, str(tmp_path)]
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
        remove_unfinished(tmp_path)
        assert {*os.listdir(tmp_path)} == unfinished | {*foreign_names}
        process.kill()
        process.wait()
        remove_unfinished(tmp_path)
        assert {*os.listdir(tmp_path)} == {*foreign_names}


def test_without_locks_nothing_is_swept_and_all_is_written(tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    (tmp_path / ".0123456789abcdef.pw-elements-unfinished").write_text("perhaps another's")
    monkeypatch.setattr(fcntl, "flock", no_locks)
    replace_file(tmp_path / "file", NEW_CONTENT)
    make_folder(tmp_path / "made", one="1")
    assert len(os.listdir(tmp_path)) == 3
    monkeypatch.undo()
    remove_unfinished(tmp_path)
    assert sorted(os.listdir(tmp_path)) == ["file", "made"]


def test_names_of_unfinished_files_are_not_foreseeable_and_long_names_no_obstacle(
    tmp_path, monkeypatch
):
    temporary_names, replace = [], os.replace

    def record_name(source, target):
        temporary_names.append(source)
        replace(source, target)

    monkeypatch.setattr(os, "replace", record_name)
    for _ in range(2):
        replace_file(tmp_path / ("n" * 255), NEW_CONTENT)
    assert len({*temporary_names}) == 2
    monkeypatch.setattr("secrets.token_hex", lambda _: "0" * 16)
    (tmp_path / f".{'0' * 16}.pw-elements-unfinished").symlink_to(tmp_path / "foreign")
    with pytest.raises(FileExistsError):
        replace_file(tmp_path / "file", NEW_CONTENT)
    assert not (tmp_path / "foreign").exists()
