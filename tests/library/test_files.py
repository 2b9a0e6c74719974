"""Files and folders: old or new whatever fails, and nothing foreign touched."""

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
from tests.faults import CASES, ERRORS, KIND, NEW, failing, judge, surroundings

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("error", ERRORS, ids=lambda number: errno.errorcode[number])
@pytest.mark.parametrize("name", CASES)
def test_a_call_that_fails_leaves_the_old_or_the_new_and_nothing_else(name, error):
    case, raised = CASES[name], []
    for number in count(1):
        with surroundings() as folder:
            case.prepare(folder)
            reached, failed = failing(lambda at=folder: case.operate(at), number, error)
            if not reached:
                break
            assert failed is None or isinstance(failed, OSError), failed
            raised.append(failed)
            judge(case, folder, failed)
    assert number > 15
    assert sum(failed is not None for failed in raised) > 5


@pytest.mark.parametrize("name", CASES)
def test_a_kill_at_any_call_leaves_the_old_or_the_new_and_the_next_call_cleans(name):
    command = [sys.executable, "-W", "ignore", "-m", "tests.faults", name]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[2]) > 20, done.stdout


def make(path, **content):
    with replacing_folder(path, KIND) as made:
        for name, text in content.items():
            (made.folder / name).write_text(text)


def test_a_folder_is_replaced_if_all_in_it_was_written_with_it(tmp_path):
    path = tmp_path / "made"
    make(path, one="1", two="2")
    make(path, one="11")
    assert sorted(os.listdir(path)) == [MARK_NAME, "one"]
    (path / "two").write_text("mine")
    (path / "deep").mkdir()
    with pytest.raises(ForeignEntry, match="it holds deep/, two, not written with it"):
        make(path, one="111")
    assert (path / "two").read_text() == "mine"
    assert (path / "one").read_text() == "11"
    (path / "two").unlink()
    (path / "deep").rmdir()
    (path / "one").unlink()
    (path / "one").mkdir()
    with pytest.raises(ForeignEntry, match="it holds one/"):
        make(path)
    assert os.listdir(tmp_path) == ["made"]


@pytest.mark.parametrize("mark", [None, "", "{", "[]", '{"kind": "K"}', "other kind"])
def test_a_folder_without_the_right_mark_is_not_replaced(tmp_path, mark):
    path = tmp_path / "made"
    if mark == "other kind":
        with replacing_folder(path, "something else") as made:
            (made.folder / "one").write_text("mine")
    else:
        path.mkdir()
        (path / "one").write_text("mine")
        if mark is not None:
            (path / MARK_NAME).write_text(mark.replace("K", KIND))
    with pytest.raises(ForeignEntry, match="does not say that it is a folder of this test"):
        make(path, one="2")
    with pytest.raises(ForeignEntry, match="is not empty, and does not say"):
        claim_folder(path, KIND)
    assert (path / "one").read_text() == "mine"
    assert os.listdir(tmp_path) == ["made"]
    if mark is not None:  # the mark may be all that the user has there
        (path / "one").unlink()
        before = (path / MARK_NAME).read_text()
        with pytest.raises(ForeignEntry):
            claim_folder(path, KIND)
        with pytest.raises(ForeignEntry):
            make(path, one="2")
        assert (path / MARK_NAME).read_text() == before


def test_files_and_links_in_the_place_of_a_folder(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ForeignEntry, match="is no folder"):
        make(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    link = tmp_path / "link"
    link.symlink_to(elsewhere / "made")
    for text in ("1", "2"):
        make(link, one=text)
        assert link.is_symlink()
        assert (elsewhere / "made" / "one").read_text() == text
    (elsewhere / "made" / "two").symlink_to(tmp_path / "file")
    with pytest.raises(ForeignEntry, match="it holds two"):
        make(link, one="3")


def test_what_comes_into_a_folder_while_another_one_is_made_is_kept(tmp_path):
    path = tmp_path / "made"
    for before in (False, True):
        made = FolderReplacement(path, KIND)
        made.start()
        (made.folder / "one").write_text("new")
        path.mkdir(exist_ok=True)
        (path / "late").write_text("mine")
        with pytest.raises(ForeignEntry, match="not replaced"):
            made.commit()
        made.abandon()
        assert (path / "late").read_text() == "mine"
        assert os.listdir(tmp_path) == ["made"]
        (path / "late").unlink()
        if not before:
            make(path, one="old")


@pytest.mark.parametrize("exchanges", [True, False])
def test_what_comes_at_the_last_moment_is_kept_too(tmp_path, monkeypatch, exchanges):
    path, exchange = tmp_path / "made", files._exchange
    make(path, one="old")

    def late(one, other):
        if (path / "one").read_text() == "old":
            (path / "late").write_text("mine")
        return exchange(one, other) if exchanges else False

    monkeypatch.setattr(files, "_exchange", late)
    with pytest.raises(ForeignEntry, match="it holds late"):
        make(path, one="new")
    assert ((path / "one").read_text(), (path / "late").read_text()) == ("old", "mine")
    assert os.listdir(tmp_path) == ["made"]


def test_only_files_of_ours_are_replaced_and_no_others_than_regular_ones(tmp_path):
    path = tmp_path / "file"

    def ours(there):
        return there.read_bytes().startswith(b"ours")

    replace_file(path, b"ours", ours)
    replace_file(path, b"mine", ours)
    with pytest.raises(ForeignEntry, match="was not written by pw_elements"):
        replace_file(path, NEW, ours)
    assert path.read_bytes() == b"mine"
    os.mkfifo(tmp_path / "fifo")
    for irregular in (tmp_path / "fifo", tmp_path, Path("/dev/null")):
        with pytest.raises(ForeignEntry, match="no regular file"):
            replace_file(irregular, NEW)
    (tmp_path / "link").symlink_to(path)
    replace_file(tmp_path / "link", NEW)
    assert (tmp_path / "link").is_symlink()
    assert path.read_bytes() == NEW


def test_errors_name_what_was_to_be_written(tmp_path):
    for call in (lambda at: replace_file(at, NEW), make):
        with pytest.raises(FileNotFoundError) as caught:
            call(tmp_path / "nowhere" / "made")
        assert caught.value.filename == str(tmp_path / "nowhere" / "made")


def test_a_mark_of_a_folder_of_files_outlives_its_own_replacement(tmp_path):
    out = tmp_path / "deep" / "out"
    for _ in range(2):
        claim_folder(out, KIND)
    (out / "mine").write_text("more")
    claim_folder(out, KIND)
    with pytest.raises(ForeignEntry):
        claim_folder(out, "another kind")
    with pytest.raises(ForeignEntry):  # which has no list of what is in it
        check_folder_replaceable(out, KIND)
    other = tmp_path / "other"
    other.mkdir()
    (other / "mine").write_text("more")
    claim_folder(other, KIND, lambda folder: (folder / "mine").exists())
    assert sorted(os.listdir(other)) == [MARK_NAME, "mine"]


WRITE = """
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
    command = [sys.executable, "-c", WRITE, str(tmp_path)]
    kept = [
        ".a.json.0123456789abcdef.4.pw-elements-unfinished",
        ".0123456789abcdef.pw-elements-unfinished.txt",
        "0123456789abcdef.pw-elements-unfinished",
    ]
    for name in kept:
        (tmp_path / name).write_text("mine")
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "cwd": ROOT}
    with subprocess.Popen(command, **pipes) as process:
        assert process.stdout.readline() == b"begun\n"
        unfinished = {*os.listdir(tmp_path)} - {*kept}
        assert len(unfinished) == 2
        remove_unfinished(tmp_path)
        assert {*os.listdir(tmp_path)} == unfinished | {*kept}
        process.kill()
        process.wait()
        remove_unfinished(tmp_path)
        assert {*os.listdir(tmp_path)} == {*kept}


def test_without_locks_nothing_is_swept_and_all_is_written(tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    (tmp_path / ".0123456789abcdef.pw-elements-unfinished").write_text("perhaps another's")
    monkeypatch.setattr(fcntl, "flock", no_locks)
    replace_file(tmp_path / "file", NEW)
    make(tmp_path / "made", one="1")
    assert len(os.listdir(tmp_path)) == 3
    monkeypatch.undo()
    remove_unfinished(tmp_path)
    assert sorted(os.listdir(tmp_path)) == ["file", "made"]


def test_names_of_unfinished_files_are_not_foreseeable_and_long_names_no_obstacle(
    tmp_path, monkeypatch
):
    seen, replace = [], os.replace

    def watched(source, target):
        seen.append(source)
        replace(source, target)

    monkeypatch.setattr(os, "replace", watched)
    for _ in range(2):
        replace_file(tmp_path / ("n" * 255), NEW)
    assert len({*seen}) == 2
    monkeypatch.setattr("secrets.token_hex", lambda _: "0" * 16)
    (tmp_path / f".{'0' * 16}.pw-elements-unfinished").symlink_to(tmp_path / "foreign")
    with pytest.raises(FileExistsError):
        replace_file(tmp_path / "file", NEW)
    assert not (tmp_path / "foreign").exists()
