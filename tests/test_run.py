"""The entry script, called from within itself: it then takes the Python that runs the tests."""

import os
import re
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

import pypdf
import pytest

ROOT = Path(__file__).parents[1]
RUN = ROOT / "run"
# HOME in the Debian that ./run unpacks
PRIVATE = os.environ.get("HOME") == "/usr/private"
private_only = pytest.mark.skipif(not PRIVATE, reason="not in the Debian that ./run unpacks")


def run(*args, cwd=ROOT, script=RUN, **env):
    """The finished process of the script; a variable given as None is unset."""
    merged = {k: v for k, v in {**os.environ, **env}.items() if v is not None}
    return subprocess.run([script, *args], cwd=cwd, env=merged, capture_output=True, text=True)


def environment(**env):
    lines = run("env", **env).stdout.splitlines()
    return dict(line.split("=", 1) for line in lines if "=" in line)


def mount_points():
    lines = Path("/proc/self/mountinfo").read_text().splitlines()
    return [line.split()[4] for line in lines]


def test_help_is_the_head_of_the_file(tmp_path):
    head = RUN.read_text().split("\nset -eu\n")[0].splitlines()[1:]
    expected = [line.removeprefix("#").removeprefix(" ") for line in head]
    relative = os.path.relpath(RUN, tmp_path)
    for process in (run(), run("--help"), run(cwd=tmp_path, script=relative)):
        assert process.returncode == 0, process.stderr
        assert process.stdout.splitlines() == expected
    assert "./run study" in process.stdout
    assert "./run test" in process.stdout


def test_arguments_folder_and_exit_status_pass_through(tmp_path):
    arguments = ["", "two words", "$HOME 'and' \"quotes\"", "σ", "*"]
    code = f"import os, sys; assert sys.argv[1:] == {arguments}; print(os.getcwd()); sys.exit(7)"
    process = run("python3", "-c", code, *arguments, cwd=tmp_path)
    assert process.stderr == ""
    assert process.stdout.strip() == str(ROOT)
    assert process.returncode == 7


def test_a_signal_passes_through():
    assert run("sh", "-c", "kill -TERM $$").returncode == -signal.SIGTERM


def test_one_thread_unless_asked_for_more():
    assert environment(OMP_NUM_THREADS=None)["OMP_NUM_THREADS"] == "1"
    assert environment(OMP_NUM_THREADS="2")["OMP_NUM_THREADS"] == "2"


def told(folder, git):
    """What ./run tells of the commit, with a shell script as git."""
    (folder / "git").write_text(f"#!/bin/sh\n{git}\n")
    (folder / "git").chmod(0o755)
    path = f"{folder}:{os.environ['PATH']}"
    variables = environment(PATH=path, PW_ELEMENTS_COMMIT=None, PW_ELEMENTS_DIRTY=None)
    return {k: v for k, v in variables.items() if k.startswith("PW_ELEMENTS_")}


@pytest.mark.parametrize(("changes", "dirty"), [("", "0"), (" M run", "1")])
def test_commit_and_its_changes_are_told(tmp_path, changes, dirty):
    git = f"case $* in *rev-parse*) echo abc ;; *status*) echo '{changes}' ;; esac"
    assert told(tmp_path, git) == {"PW_ELEMENTS_COMMIT": "abc", "PW_ELEMENTS_DIRTY": dirty}


def test_no_commit_is_told_where_there_is_none(tmp_path):
    assert told(tmp_path, "exit 128") == {}


def test_commit_is_that_of_the_checkout():
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    if "PW_ELEMENTS_COMMIT" not in os.environ:
        pytest.skip("no git on this machine, or not started by ./run")
    assert re.fullmatch("[0-9a-f]{40}", os.environ["PW_ELEMENTS_COMMIT"])
    assert os.environ["PW_ELEMENTS_DIRTY"] in ("0", "1")


def test_folders_outside_the_project_can_be_written():
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        (Path(folder) / "result").write_text("kept")
    if PRIVATE:
        points = mount_points()
        assert "/var" in points
        assert "/tmp" in points


@private_only
def test_the_debian_itself_takes_no_results():
    for folder in ("/usr", "/etc"):
        with pytest.raises(OSError, match="Read-only"):
            tempfile.mkdtemp(dir=folder)


@private_only
def test_no_folder_shows_twice():
    """The cache folder is among the bound ones: an rm -r of it must not reach them."""
    assert [p for p in mount_points() if p.endswith("/usr/private")] == ["/usr/private"]


def test_text_in_pdf_is_dejavu(tmp_path):
    code = (
        "import sys, weasyprint;"
        "html = '<p style=\"font-family: DejaVu Sans\">σ <b>bold</b> <i>italic</i>';"
        "weasyprint.HTML(string=html).write_pdf(sys.argv[1])"
    )
    file = tmp_path / "a.pdf"
    process = run("python3", "-c", code, str(file))
    assert process.returncode == 0
    assert process.stderr == ""  # fontconfig warns there
    fonts = pypdf.PdfReader(file).pages[0]["/Resources"]["/Font"].values()
    names = {font.get_object()["/BaseFont"].split("+")[1] for font in fonts}
    assert names == {"DejaVu-Sans", "DejaVu-Sans-Bold", "DejaVu-Sans-Oblique"}


@pytest.mark.skipif(not shutil.which("shellcheck"), reason="shellcheck is not installed")
def test_shellcheck():
    process = subprocess.run(
        ["shellcheck", "run", ".ci/run", ".ci/nightly"], cwd=ROOT, capture_output=True, text=True
    )
    assert process.returncode == 0, process.stdout
