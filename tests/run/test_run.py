"""The entry script, called from within itself: it then takes the Python that runs the tests."""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

ROOT = Path(__file__).parents[2]
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
    assert process.stdout.strip() == str(tmp_path)
    assert process.returncode == 7


def test_a_script_elsewhere_finds_the_library_and_packages_of_its_own(tmp_path):
    script, mine = tmp_path / "work" / "plate.py", tmp_path / "mine"
    for path, text in {
        script: "import own, pw_elements as pw; open('out', 'w').write(own.word + pw.__file__)",
        mine / "own.py": "word = 'from '",
    }.items():
        path.parent.mkdir()
        path.write_text(text)
    process = run("python3", "plate.py", cwd=script.parent, PW_ELEMENTS_PATH=str(mine))
    assert process.stderr == ""
    assert (script.parent / "out").read_text() == f"from {ROOT}/pw_elements/__init__.py"


def test_the_study_takes_folders_as_they_are_meant_where_it_is_called(tmp_path):
    process = run("study", "check", "--out", "mine", cwd=tmp_path)
    assert process.stderr == f"study: there are no results in {tmp_path}/mine: run ./run study\n"


def test_tests_start_in_the_project_tell_their_number_and_a_pipe_has_it_at_once(tmp_path):
    (tmp_path / "test_toy.py").write_text("import time\ndef test_it(): time.sleep(120)\n")
    options = ["-c", "pyproject.toml", "--rootdir", ROOT, "-p", "tests.conftest"]
    command = [RUN, "test", *options, tmp_path / "test_toy.py"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    lines = iter(process.stdout.readline, "")
    told = next(line for line in lines if "tests, " in line)  # the test goes on meanwhile
    process.kill()
    process.communicate()
    assert re.match(r"1 tests, about \d+ (s|min) by \d+ at a time \((as|not)", told)


def test_layers_that_are_none_and_options_that_are_none_are_refused():
    process = run("--with", "study,moon", "true")
    assert process.stderr == "run: there is no layer moon, but core, study, test, docs and pip\n"
    assert process.returncode == 1
    assert "needs layers and a command" in run("--with", "study").stderr
    assert "no option --fast" in run("--fast").stderr


def test_figure_is_written_where_the_caller_is(tmp_path):
    process = run("figure", "fig04", "--results", "mine", "--out", "drawn", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    written = [tmp_path / "drawn" / name for name in ("fig04.png", "fig04.pdf")]
    assert process.stdout.splitlines() == [str(path) for path in written]
    assert all(path.stat().st_size > 1000 for path in written)
    assert plt.imread(written[0]).shape[1] == 480  # 2.4 inches
    assert (tmp_path / "mine" / "7.1" / "pw-T6.json").exists()


TOOLS = (
    "sh env id dirname readlink sed tr sort tail cut cksum mkdir uname git head awk rm mktemp ls "
    "cat cp find rmdir touch"
)


@pytest.fixture
def bare(tmp_path):
    """A function that runs the script on a system with an old DOLFINx and few programs.

    Programs of the names given do what the texts say.
    """
    programs, packages = tmp_path / "bin", tmp_path / "packages"
    (packages / "dolfinx" / "fem").mkdir(parents=True)
    for name in ("__init__", "petsc"):
        (packages / "dolfinx" / "fem" / f"{name}.py").write_text("")
    programs.mkdir()
    for tool in TOOLS.split():
        if found := shutil.which(tool):
            (programs / tool).symlink_to(found)

    def start(*args, script=RUN, env=None, has="0.8.0", **stubs):
        (packages / "dolfinx" / "__init__.py").write_text(f"__version__ = '{has}'")
        for name, text in stubs.items():
            path = programs / name.replace("_", "-")
            path.unlink(missing_ok=True)
            path.write_text(f"#!/bin/sh\n{text}\n")
            path.chmod(0o755)
        given = {
            "PYTHONPATH": str(packages),
            "PATH": str(programs),
            "XDG_CACHE_HOME": str(tmp_path),
        }
        # a suite of one's own would be told in place of what Python lacks
        return run(
            *args, cwd=tmp_path, script=script, **(given | (env or {})), PW_ELEMENTS_SUITE=None
        )

    return start


FOUND = {
    "apt_get": "echo $* >>apt.log",
    "apt_cache": "echo Candidate: 1:0.9.0-1",
    "dpkg_deb": "",
    "flock": "",
    "unshare": "",
}


MOUNTS = {"mount": "", "chroot": ""}
NO_MOUNT = "no mount (apt-get install mount, as root)"


@pytest.mark.parametrize(
    ("programs", "words"),
    [
        ({}, "python3 has DOLFINx 0.8.0 in place of 0.9 or 0.11, and there is no apt-get to fetch"),
        ({"has": "0.10.0.post2"}, "python3 has DOLFINx 0.10.0.post2 in place of 0.9 or 0.11, and"),
        (FOUND | {"id": "echo 1000"}, f"{NO_MOUNT}: start this as root"),
        *(
            (
                FOUND | {"id": "echo 0", "apt_cache": f"echo Candidate: {old}"},
                f"{NO_MOUNT}, and apt offers no DOLFINx 0.9 or 0.11",
            )
            for old in ("1:0.10.0-2", "(none)")
        ),
        (
            FOUND | MOUNTS | {"id": "echo 1000", "unshare": "exit 1"},
            "namespaces are not allowed here: start this as root",
        ),
        (
            FOUND | MOUNTS | {"id": "echo 1000", "unshare": "exit 1", "sysctl": "echo 1"},
            "AppArmor forbids namespaces (sysctl kernel.apparmor_restrict_unprivileged_userns=0, ",
        ),
    ],
)
def test_who_gets_no_dolfinx_is_told_what_to_do(bare, programs, words):
    process = bare("true", **programs)
    assert process.returncode == 1
    assert words in process.stderr
    assert "conda create" in process.stderr


@pytest.mark.parametrize(
    ("command", "tests"),
    [(["sh", "-c", "echo went"], False), (["--with", "test", "echo", "went"], True)],
)
def test_without_mount_root_goes_on_to_the_systems_own_packages(bare, tmp_path, command, tests):
    process = bare(*command, **FOUND, id="echo 0", dpkg="")
    assert process.stdout == "went\n", process.stderr
    assert f"{NO_MOUNT}: installing DOLFINx 1:0.9" in process.stderr
    installed = (tmp_path / "apt.log").read_text()
    assert "python3-dolfinx" in installed
    assert "weasyprint" not in installed
    assert ("python3-pytest" in installed) == tests


CODENAME = "$VERSION_CODENAME"
LISTED = """case "$*" in
*--print-uris*) . /etc/os-release && echo "'http://system/dists/$VERSION_CODENAME/InRelease' x" ;;
*update*) echo unreachable && exit 100 ;; esac"""


@pytest.mark.parametrize(
    ("given", "name"), [(None, CODENAME), (None, "sid"), ("http://given/debian", CODENAME)]
)
def test_without_a_debian_mirror_one_is_asked_for_and_a_given_one_is_taken(
    bare, tmp_path, given, name
):
    """Sid's mirror has the name of no release."""
    env = {"PW_ELEMENTS_MIRROR": given} if given else {}
    listed = LISTED.replace(CODENAME, name)
    programs = FOUND | MOUNTS | {"id": "echo 0", "dpkg": "echo amd64", "apt_get": listed}
    process = bare("true", env=env, **programs)
    assert process.returncode == 1
    assert "name one by PW_ELEMENTS_MIRROR=ADDRESS" in process.stderr
    assert f"Tried: {given or 'http://system'}. unreachable" in process.stderr
    (written,) = tmp_path.glob("pw-elements/*.apt/list")
    assert written.read_text() == f"deb {given or 'http://system'} trixie main\n"


def test_folders_in_the_cache_without_a_mark_are_not_deleted(bare, tmp_path):
    """What an earlier start has left is, mark and all."""
    programs = FOUND | MOUNTS | {"id": "echo 0", "dpkg": "echo amd64", "apt_get": LISTED}
    assert "Tried: " in bare("true", **programs).stderr
    (made,) = tmp_path.glob("pw-elements/*.apt")
    assert (made / ".pw-elements").is_file()
    left = made.with_suffix(".new")
    for folder in (made, left):
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "deep").mkdir(parents=True)
        (folder / "deep" / "mine").write_text("kept")
        process = bare("true", **programs)
        words = f"{folder} has not been made by this script: move it away"
        assert (process.returncode, words in process.stderr) == (1, True)
        assert (folder / "deep" / "mine").read_text() == "kept"
        (folder / ".pw-elements").touch()
    assert "Tried: " in bare("true", **programs).stderr
    assert not left.exists()


def test_shared_memory_of_other_programs_is_left_alone(tmp_path):
    segment = tmp_path / "sm_segment.theirs"
    segment.write_text("")
    os.utime(segment, (0, 0))
    assert run("true", OMPI_MCA_btl_sm_backing_directory=str(tmp_path)).returncode == 0
    assert segment.exists()


@pytest.mark.parametrize("there", [False, True])
def test_debians_keys_are_fetched_or_the_lists_that_lead_to_them_asked_for(bare, tmp_path, there):
    script, keys = tmp_path / "project" / "run", "usr/share/keyrings/debian-archive-keyring.gpg"
    script.parent.mkdir()
    script.write_text(RUN.read_text().replace(f"/{keys}", f"/nowhere/{keys}"))
    script.chmod(0o755)
    unpack = f"mkdir -p nowhere/{keys.rpartition('/')[0]}; echo theirs >nowhere/{keys}"
    listed = LISTED if there else 'case "$*" in *download*) exit 100 ;; esac'
    programs = FOUND | MOUNTS | {"id": "echo 0", "dpkg": "echo amd64", "apt_get": listed}
    process = bare("true", script=script, **programs | {"dpkg_deb": unpack})
    needs = "the package debian-archive-keyring, and apt cannot find it: do apt-get update"
    assert process.returncode == 1
    assert (needs in process.stderr) != there
    copies = [*tmp_path.glob("pw-elements/*.apt/keys/*")]
    assert [copy.read_text() for copy in copies] == ["theirs\n"] * there


def test_dolfinx_0_10_is_refused_by_the_metadata_and_the_library_too(tmp_path):
    assert '"fenics-dolfinx >=0.9, !=0.10.*, <0.12"' in (ROOT / "pyproject.toml").read_text()
    (tmp_path / "dolfinx.py").write_text("__version__ = '0.10.0'")
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{ROOT}"}
    command = [sys.executable, "-c", "import pw_elements"]
    process = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert "ImportError: pw_elements needs DOLFINx 0.9 or 0.11" in process.stderr


def test_nowhere_to_keep_the_packages_is_one_sentence(bare, tmp_path):
    script = tmp_path / "project" / "run"
    script.parent.mkdir()
    shutil.copy(RUN, script)
    (script.parent / ".cache").write_text("no folder")
    env = {"XDG_CACHE_HOME": None, "HOME": "/proc/none"}
    process = bare("true", script=script, env=env, **FOUND, id="echo 0")
    assert process.returncode == 1
    assert process.stderr.startswith(
        "run: no folder to keep DOLFINx in: name one by XDG_CACHE_HOME"
    )
    assert process.stderr.count("\n") == 1


@pytest.mark.parametrize("mode", [0o775, 0o757, 0o777])
def test_a_cache_folder_that_others_may_write_to_is_not_trusted(bare, tmp_path, mode):
    script, theirs = tmp_path / "project" / "run", tmp_path / "open"
    script.parent.mkdir()
    shutil.copy(RUN, script)
    (script.parent / ".cache").write_text("no folder")
    folder = theirs / "pw-elements"
    folder.mkdir(parents=True)
    folder.chmod(mode)
    env, programs = {"XDG_CACHE_HOME": str(theirs)}, FOUND | {"id": "echo 0"}
    process = bare("true", script=script, env=env, **programs)
    assert process.returncode == 1
    assert f"run: others may write to {folder}, which is not used" in process.stderr
    assert list(folder.iterdir()) == []
    folder.chmod(0o755)
    assert "others may write" not in bare("true", script=script, env=env, **programs).stderr


def test_folders_for_dolfinx_are_made_so_that_others_cannot_write_to_them(bare, tmp_path):
    command, cache = f"umask 000; exec {RUN} true", tmp_path / "open-to-all"
    programs = FOUND | MOUNTS | {"id": "echo 0", "dpkg": "echo amd64", "apt_get": LISTED}
    env = {"XDG_CACHE_HOME": str(cache)}
    bare("-c", command, script="/bin/sh", env=env, **programs)
    folders = [path for path in cache.rglob("*") if path.is_dir()]
    assert folders
    assert [path for path in folders if path.stat().st_mode & 0o022] == []


def test_a_signal_passes_through():
    assert run("sh", "-c", "kill -TERM $$").returncode == -signal.SIGTERM


def test_processes_share_memory_in_a_folder_of_the_users_own():
    folder = Path(environment()["OMPI_MCA_btl_sm_backing_directory"])
    assert re.fullmatch(r"/dev/shm/pw-elements-\d+", str(folder))
    assert (folder.stat().st_mode & 0o777, folder.stat().st_uid) == (0o700, os.getuid())
    left = folder / "sm_segment.left-behind"
    left.write_text("")
    os.utime(left, (0, 0))
    run("true")
    assert not left.exists()


COMMIT = "case $* in *rev-parse*) echo abc ;; *status*) echo '{}' ;; esac"


@pytest.mark.parametrize(
    ("git", "expected", "threads"),
    [
        (COMMIT.format(""), {"PW_ELEMENTS_COMMIT": "abc", "PW_ELEMENTS_DIRTY": "0"}, None),
        (COMMIT.format(" M run"), {"PW_ELEMENTS_COMMIT": "abc", "PW_ELEMENTS_DIRTY": "1"}, "2"),
        ("exit 128", {}, None),
    ],
)
def test_commit_its_changes_and_threads_are_told(tmp_path, git, expected, threads):
    """With a shell script as git; one thread unless asked for more."""
    (tmp_path / "git").write_text(f"#!/bin/sh\n{git}\n")
    (tmp_path / "git").chmod(0o755)
    given = dict.fromkeys(("PW_ELEMENTS_COMMIT", "PW_ELEMENTS_DIRTY"))
    path = f"{tmp_path}:{os.environ['PATH']}"
    variables = environment(PATH=path, OMP_NUM_THREADS=threads, **given)
    assert {k: v for k, v in variables.items() if k.startswith("PW_ELEMENTS_")} == expected
    assert variables["OMP_NUM_THREADS"] == (threads or "1")


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


@pytest.mark.skipif(not shutil.which("shellcheck"), reason="shellcheck is not installed")
def test_shellcheck():
    process = subprocess.run(
        ["shellcheck", "run", ".ci/run", ".ci/nightly", ".ci/package", ".ci/signals.sh"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stdout
