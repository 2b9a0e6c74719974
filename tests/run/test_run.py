"""The script `run`, called from within itself, so that it uses the Python that runs the tests."""

import os
import re
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

ROOT = Path(__file__).parents[2]
RUN_SCRIPT = ROOT / "run"
# HOME in the Debian that ./run unpacks
IS_IN_UNPACKED_DEBIAN = os.environ.get("HOME") == "/usr/private"
only_in_unpacked_debian = pytest.mark.skipif(
    not IS_IN_UNPACKED_DEBIAN, reason="not in the Debian that ./run unpacks"
)


def run_script(*args, cwd=ROOT, script=RUN_SCRIPT, **env):
    """Run the script, and return the completed process.

    The keyword arguments `env` are environment variables; a variable given as None is unset.
    """
    merged = {k: v for k, v in {**os.environ, **env}.items() if v is not None}
    return subprocess.run([script, *args], cwd=cwd, env=merged, capture_output=True, text=True)


def read_environment_of_started_command(**env):
    """Return the environment variables of a command that the script starts."""
    lines = run_script("env", **env).stdout.splitlines()
    return dict(line.split("=", 1) for line in lines if "=" in line)


def list_mount_points():
    """Return the mount points that this process sees."""
    lines = Path("/proc/self/mountinfo").read_text().splitlines()
    return [line.split()[4] for line in lines]


def test_the_help_is_the_head_comment_of_the_file(tmp_path):
    head = RUN_SCRIPT.read_text().split("\nset -eu\n")[0].splitlines()[1:]
    expected = [line.removeprefix("#").removeprefix(" ") for line in head]
    relative = os.path.relpath(RUN_SCRIPT, tmp_path)
    for process in (run_script(), run_script("--help"), run_script(cwd=tmp_path, script=relative)):
        assert process.returncode == 0, process.stderr
        assert process.stdout.splitlines() == expected
    assert "./run study" in process.stdout
    assert "./run test" in process.stdout


def test_arguments_folder_and_exit_status_are_passed_on(tmp_path):
    arguments = ["", "two words", "$HOME 'and' \"quotes\"", "σ", "*"]
    code = f"import os, sys; assert sys.argv[1:] == {arguments}; print(os.getcwd()); sys.exit(7)"
    process = run_script("python3", "-c", code, *arguments, cwd=tmp_path)
    assert process.stderr == ""
    assert process.stdout.strip() == str(tmp_path)
    assert process.returncode == 7


def test_a_script_in_another_folder_finds_the_library_and_its_own_modules(tmp_path):
    script, own_modules = tmp_path / "work" / "plate.py", tmp_path / "mine"
    for path, text in {
        script: "import own, pw_elements as pw; open('out', 'w').write(own.word + pw.__file__)",
        own_modules / "own.py": "word = 'from '",
    }.items():
        path.parent.mkdir()
        path.write_text(text)
    process = run_script(
        "python3", "plate.py", cwd=script.parent, PW_ELEMENTS_PATH=str(own_modules)
    )
    assert process.stderr == ""
    assert (script.parent / "out").read_text() == f"from {ROOT}/pw_elements/__init__.py"


def test_the_study_resolves_folders_relative_to_the_current_folder(tmp_path):
    process = run_script("study", "check", "--out", "mine", cwd=tmp_path)
    assert process.stderr == f"study: there are no results in {tmp_path}/mine: run ./run study\n"


def test_tests_run_in_the_project_and_print_their_number_at_once(tmp_path):
    (tmp_path / "test_toy.py").write_text("import time\ndef test_it(): time.sleep(120)\n")
    options = ["-c", "pyproject.toml", "--rootdir", ROOT, "-p", "tests.conftest"]
    command = [RUN_SCRIPT, "test", *options, tmp_path / "test_toy.py"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    lines = iter(process.stdout.readline, "")
    summary = next(line for line in lines if "tests, " in line)  # the test is still running
    process.kill()
    process.communicate()
    assert re.match(r"1 tests, about \d+ (s|min) by \d+ at a time \((as|not)", summary)


def test_unknown_layers_and_options_are_refused():
    process = run_script("--with", "study,moon", "true")
    assert (
        process.stderr
        == "run: there is no layer moon; the layers are core, study, test, docs and pip\n"
    )
    assert process.returncode == 1
    assert "needs layers and a command" in run_script("--with", "study").stderr
    assert "no option --fast" in run_script("--fast").stderr


def test_a_figure_is_written_relative_to_the_current_folder(tmp_path):
    process = run_script("figure", "fig04", "--results", "mine", "--out", "drawn", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    written = [tmp_path / "drawn" / name for name in ("fig04.png", "fig04.pdf")]
    *paths, caption = process.stdout.splitlines()
    assert paths == [str(path) for path in written]
    assert caption.startswith("Unit square of unit thickness, two 6-node triangles")
    assert all(path.stat().st_size > 1000 for path in written)
    assert plt.imread(written[0]).shape[1] == 480  # 2.4 inches
    assert (tmp_path / "mine" / "7.1" / "pw-T6.json").exists()


BASIC_TOOLS = (
    "sh env id dirname readlink sed tr sort tail cut cksum mkdir uname git head awk rm mktemp ls "
    "cat cp find rmdir touch chmod"
)


@pytest.fixture
def run_on_bare_system(tmp_path):
    """Return a function that runs the script with an old DOLFINx and few other programs.

    Each keyword argument of the returned function is the name of a program and its shell code.
    """
    programs, packages = tmp_path / "bin", tmp_path / "packages"
    (packages / "dolfinx" / "fem").mkdir(parents=True)
    for name in ("__init__", "petsc"):
        (packages / "dolfinx" / "fem" / f"{name}.py").write_text("")
    programs.mkdir()
    for tool in BASIC_TOOLS.split():
        if path := shutil.which(tool):
            (programs / tool).symlink_to(path)

    def run_with_stubs(*args, script=RUN_SCRIPT, env=None, dolfinx_version="0.8.0", **stubs):
        """Run a script with stub programs, which are given by their names and shell code."""
        (packages / "dolfinx" / "__init__.py").write_text(f"__version__ = '{dolfinx_version}'")
        for name, text in stubs.items():
            path = programs / name.replace("_", "-")
            path.unlink(missing_ok=True)
            path.write_text(f"#!/bin/sh\n{text}\n")
            path.chmod(0o755)
        variables = {
            "PYTHONPATH": str(packages),
            "PATH": str(programs),
            "XDG_CACHE_HOME": str(tmp_path),
        }
        # with a suite set, the message would name it instead of the missing modules
        return run_script(
            *args, cwd=tmp_path, script=script, **(variables | (env or {})), PW_ELEMENTS_SUITE=None
        )

    return run_with_stubs


APT_STUBS = {
    "apt_get": "echo $* >>apt.log",
    "apt_cache": "echo Candidate: 1:0.9.0-1",
    "dpkg_deb": "",
    "flock": "",
    "unshare": "",
}


MOUNT_STUBS = {"mount": "", "chroot": ""}
NO_MOUNT_MESSAGE = "no mount (apt-get install mount, as root)"
ON_ARM = {"uname": "echo aarch64"}  # there is no wheel of DOLFINx


@pytest.mark.parametrize(
    ("programs", "message"),
    [
        ({}, "python3 has DOLFINx 0.8.0 in place of 0.9 or 0.11, and there is no flock to"),
        (
            ON_ARM | {"flock": "", "dolfinx_version": "0.10.0.post2"},
            "DOLFINx 0.10.0.post2 in place of 0.9 or 0.11, and there is no dpkg-deb to fetch",
        ),
        (
            ON_ARM | APT_STUBS | {"id": "echo 1000"},
            "apt has no Debian mirror (PW_ELEMENTS_MIRROR=ADDRESS names one). The wheel of",
        ),
    ],
)
def test_without_dolfinx_the_message_gives_a_remedy(run_on_bare_system, programs, message):
    process = run_on_bare_system("true", **programs)
    assert process.returncode == 1
    assert message in process.stderr
    assert "conda create" in process.stderr


@pytest.mark.parametrize(
    ("command", "tests"),
    [(["sh", "-c", "echo went"], False), (["--with", "test", "echo", "went"], True)],
)
def test_without_mount_root_installs_the_packages_of_the_system(
    run_on_bare_system, tmp_path, command, tests
):
    process = run_on_bare_system(*command, **APT_STUBS, id="echo 0", dpkg="")
    assert process.stdout == "went\n", process.stderr
    assert f"{NO_MOUNT_MESSAGE}: installing DOLFINx 1:0.9" in process.stderr
    installed = (tmp_path / "apt.log").read_text()
    assert "python3-dolfinx" in installed
    assert "weasyprint" not in installed
    assert ("python3-pytest" in installed) == tests


CODENAME_VARIABLE = "$VERSION_CODENAME"
APT_GET_STUB = """case "$*" in
*--print-uris*) . /etc/os-release && echo "'http://system/dists/$VERSION_CODENAME/InRelease' x" ;;
*update*) echo unreachable && exit 100 ;; esac"""


@pytest.mark.parametrize(
    ("mirror", "suite"),
    [(None, CODENAME_VARIABLE), (None, "sid"), ("http://given/debian", CODENAME_VARIABLE)],
)
def test_a_missing_debian_mirror_is_requested_and_a_given_one_is_used(
    run_on_bare_system, tmp_path, mirror, suite
):
    """A missing Debian mirror is asked for, and a given mirror is used.

    A mirror of Debian's sid is listed under "sid" instead of under the name of a release.
    """
    env = {"PW_ELEMENTS_MIRROR": mirror} if mirror else {}
    apt_get = APT_GET_STUB.replace(CODENAME_VARIABLE, suite)
    programs = APT_STUBS | MOUNT_STUBS | {"id": "echo 0", "dpkg": "echo amd64", "apt_get": apt_get}
    process = run_on_bare_system("true", env=env, **programs)
    assert process.returncode == 1
    assert "name one by PW_ELEMENTS_MIRROR=ADDRESS" in process.stderr
    assert f"Tried: {mirror or 'http://system'}. unreachable" in process.stderr
    (written,) = tmp_path.glob("pw-elements/*.apt/list")
    assert written.read_text() == f"deb {mirror or 'http://system'} trixie main\n"


@pytest.mark.parametrize(
    ("programs", "refusal"),
    [
        ({"id": "echo 1000"}, "there is no mount (apt-get install mount, as root)"),
        (MOUNT_STUBS | {"id": "echo 1000"}, "namespaces are not allowed here"),
        (MOUNT_STUBS | {"id": "echo 1000", "sysctl": "echo 1"}, "AppArmor forbids namespaces ("),
        (
            MOUNT_STUBS | {"id": "echo 0", "apt_cache": "echo Candidate: 1:0.10.0-2"},
            "namespaces are not allowed here",
        ),
        (
            MOUNT_STUBS | {"id": "echo 0", "apt_cache": "echo 'Candidate: (none)'"},
            "namespaces are not allowed here",
        ),
    ],
)
def test_without_namespaces_the_unpacked_debian_is_used_under_proot(
    run_on_bare_system, programs, refusal
):
    programs = APT_STUBS | {"apt_get": APT_GET_STUB, "dpkg": "", "unshare": "exit 1"} | programs
    process = run_on_bare_system("true", **programs)
    first, second, *_ = process.stderr.splitlines()
    assert "DOLFINx 0.8.0 in place of 0.9 or 0.11; taking Debian's packages, under proot" in first
    assert f"because {refusal}" in first
    assert second.startswith("run: no Debian mirror can be reached")


WITHOUT_DEBIAN_MIRROR = APT_STUBS | {
    "apt_get": "",
    "apt_cache": "echo 'Candidate: (none)'",
    "uname": "echo x86_64",
}
PYTHON_STUB = """case "$*" in
*find_spec*) echo has no dolfinx && exit 1 ;;
*"{lacking}"*) exit 1 ;;
*print*) echo 3.12 ;;
*venv*) mkdir "$4/bin" && cd "$4/bin" && echo 'echo "$*" >>pip.log' >python3 && chmod +x python3 ;;
esac"""


def test_without_a_debian_mirror_the_wheel_is_installed_once(run_on_bare_system, tmp_path):
    programs = WITHOUT_DEBIAN_MIRROR | {"python3": PYTHON_STUB.format(lacking="nothing")}
    command = ["sh", "-c", "command -v python3; echo $LD_LIBRARY_PATH"]
    process = run_on_bare_system("--with", "study,docs", *command, **programs)
    (folder,) = tmp_path.glob("pw-elements/wheel-3.12-*")
    assert process.stdout == f"{folder}/bin/python3\n{folder}/lib\n"
    assert process.stderr == (
        "run: python3 has no dolfinx; /usr/bin/python3 has DOLFINx 0.8.0 in place of 0.9 or 0.11, "
        "and apt has no Debian mirror (PW_ELEMENTS_MIRROR=ADDRESS names one): installing PyPI's "
        f"wheel dolfinx-solver-real 0.11.0.post0 and further packages, 0.9 GB, into {folder}\n"
    )
    log = (tmp_path / "pip.log").read_text()
    assert re.match(r"-I -m pip install .*--require-hashes .*/.ci/requirements-wheel.txt\n", log)
    again = run_on_bare_system(*command, **programs)
    assert (again.stdout, again.stderr) == (process.stdout, "")
    assert (tmp_path / "pip.log").read_text() == log


@pytest.mark.parametrize(
    ("command", "lacking", "packages"),
    [
        ("true", "import ensurepip", "python3-venv"),
        ("true", "Python.h", "python3-dev"),
        ("true", "shutil.which", "gcc"),
        ("study", "libpangoft2-1.0.so.0", "libpangoft2-1.0-0"),
    ],
)
def test_packages_that_the_wheel_needs_are_named(
    run_on_bare_system, tmp_path, command, lacking, packages
):
    programs = WITHOUT_DEBIAN_MIRROR | {"python3": PYTHON_STUB.format(lacking=lacking)}
    process = run_on_bare_system(command, **programs)
    assert process.returncode == 1
    assert process.stderr.count("\n") == 1
    assert (
        f"apt-get install --no-install-recommends {packages}, as root. Then start" in process.stderr
    )
    assert not [*tmp_path.glob("pw-elements/wheel-*")]


def test_a_wheel_that_cannot_be_installed_is_tried_again(run_on_bare_system, tmp_path):
    stub = PYTHON_STUB.format(lacking="nothing").replace('echo "$*" >>pip.log', "echo no; exit 1")
    process = run_on_bare_system("true", **WITHOUT_DEBIAN_MIRROR, python3=stub)
    assert process.returncode == 1
    assert process.stderr.endswith("run: the installation failed: no\n")
    stub = PYTHON_STUB.format(lacking="nothing")
    assert run_on_bare_system("env", **WITHOUT_DEBIAN_MIRROR, python3=stub).returncode == 0
    (folder,) = tmp_path.glob("pw-elements/wheel-3.12-*")
    assert {path.name for path in folder.iterdir()} == {".pw-elements", "bin", "complete"}


def test_the_wheel_and_its_dependencies_have_hashes():
    text = (ROOT / ".ci" / "requirements-wheel.txt").read_text().replace("\\\n", "")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+==\S+( +--hash=sha256:[0-9a-f]{64})+", line) for line in lines)
    assert any(line.startswith("dolfinx-solver-real==0.11.") for line in lines)


def test_folders_in_the_cache_without_a_marker_are_not_deleted(run_on_bare_system, tmp_path):
    """Folders in the cache without a marker are not deleted.

    Folders with the marker, which an earlier start has left, are deleted.
    """
    programs = (
        APT_STUBS | MOUNT_STUBS | {"id": "echo 0", "dpkg": "echo amd64", "apt_get": APT_GET_STUB}
    )
    assert "Tried: " in run_on_bare_system("true", **programs).stderr
    (apt_folder,) = tmp_path.glob("pw-elements/*.apt")
    assert (apt_folder / ".pw-elements").is_file()
    new_folder = apt_folder.with_suffix(".new")
    for folder in (apt_folder, new_folder):
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "deep").mkdir(parents=True)
        (folder / "deep" / "mine").write_text("kept")
        process = run_on_bare_system("true", **programs)
        message = f"{folder} was not created by this script: move it to another place"
        assert (process.returncode, message in process.stderr) == (1, True)
        assert (folder / "deep" / "mine").read_text() == "kept"
        (folder / ".pw-elements").touch()
    assert "Tried: " in run_on_bare_system("true", **programs).stderr
    assert not new_folder.exists()


def test_shared_memory_of_other_programs_is_kept(tmp_path):
    segment = tmp_path / "sm_segment.theirs"
    segment.write_text("")
    os.utime(segment, (0, 0))
    assert run_script("true", OMPI_MCA_btl_sm_backing_directory=str(tmp_path)).returncode == 0
    assert segment.exists()


@pytest.mark.parametrize("available", [False, True])
def test_debian_keys_are_downloaded_or_package_lists_requested(
    run_on_bare_system, tmp_path, available
):
    script, keys = tmp_path / "project" / "run", "usr/share/keyrings/debian-archive-keyring.gpg"
    script.parent.mkdir()
    script.write_text(RUN_SCRIPT.read_text().replace(f"/{keys}", f"/nowhere/{keys}"))
    script.chmod(0o755)
    unpack = f"mkdir -p nowhere/{keys.rpartition('/')[0]}; echo theirs >nowhere/{keys}"
    apt_get = APT_GET_STUB if available else 'case "$*" in *download*) exit 100 ;; esac'
    programs = APT_STUBS | MOUNT_STUBS | {"id": "echo 0", "dpkg": "echo amd64", "apt_get": apt_get}
    programs |= {"dpkg_deb": unpack, "env": {"PW_ELEMENTS_MIRROR": "http://given/debian"}}
    process = run_on_bare_system("true", script=script, **programs)
    message = "the package debian-archive-keyring, and apt cannot find it: do apt-get update"
    assert process.returncode == 1
    assert (message in process.stderr) != available
    copies = [*tmp_path.glob("pw-elements/*.apt/keys/*")]
    assert [copy.read_text() for copy in copies] == ["theirs\n"] * available


def test_no_folder_for_the_packages_gives_a_one_line_error(run_on_bare_system, tmp_path):
    script = tmp_path / "project" / "run"
    script.parent.mkdir()
    shutil.copy(RUN_SCRIPT, script)
    (script.parent / ".cache").write_text("no folder")
    env = {"XDG_CACHE_HOME": None, "HOME": "/proc/none"}
    process = run_on_bare_system("true", script=script, env=env, **APT_STUBS, id="echo 0")
    assert process.returncode == 1
    assert process.stderr.startswith("run: no folder for DOLFINx: name one by XDG_CACHE_HOME")
    assert process.stderr.count("\n") == 1


@pytest.mark.parametrize("mode", [0o775, 0o757, 0o777])
def test_a_cache_folder_that_others_may_write_to_is_not_trusted(run_on_bare_system, tmp_path, mode):
    script, open_folder = tmp_path / "project" / "run", tmp_path / "open"
    script.parent.mkdir()
    shutil.copy(RUN_SCRIPT, script)
    (script.parent / ".cache").write_text("no folder")
    folder = open_folder / "pw-elements"
    folder.mkdir(parents=True)
    folder.chmod(mode)
    env, programs = {"XDG_CACHE_HOME": str(open_folder)}, APT_STUBS | {"id": "echo 0"}
    process = run_on_bare_system("true", script=script, env=env, **programs)
    assert process.returncode == 1
    assert f"run: others may write to {folder}, which is therefore not used" in process.stderr
    assert list(folder.iterdir()) == []
    folder.chmod(0o755)
    assert (
        "others may write"
        not in run_on_bare_system("true", script=script, env=env, **programs).stderr
    )


def test_folders_for_dolfinx_are_not_writable_by_others(run_on_bare_system, tmp_path):
    command, cache = f"umask 000; exec {RUN_SCRIPT} true", tmp_path / "open-to-all"
    programs = (
        APT_STUBS | MOUNT_STUBS | {"id": "echo 0", "dpkg": "echo amd64", "apt_get": APT_GET_STUB}
    )
    env = {"XDG_CACHE_HOME": str(cache)}
    run_on_bare_system("-c", command, script="/bin/sh", env=env, **programs)
    folders = [path for path in cache.rglob("*") if path.is_dir()]
    assert folders
    assert [path for path in folders if path.stat().st_mode & 0o022] == []


def test_exit_by_a_signal_is_passed_on():
    assert run_script("sh", "-c", "kill -TERM $$").returncode == -signal.SIGTERM


def test_processes_share_memory_in_a_private_folder_of_the_user():
    folder = Path(read_environment_of_started_command()["OMPI_MCA_btl_sm_backing_directory"])
    assert re.fullmatch(r"/dev/shm/pw-elements-\d+", str(folder))
    assert (folder.stat().st_mode & 0o777, folder.stat().st_uid) == (0o700, os.getuid())
    old_segment = folder / "sm_segment.left-behind"
    old_segment.write_text("")
    os.utime(old_segment, (0, 0))
    run_script("true")
    assert not old_segment.exists()


GIT_STUB_TEMPLATE = "case $* in *rev-parse*) echo abc ;; *status*) echo '{}' ;; esac"


@pytest.mark.parametrize(
    ("git", "expected", "threads"),
    [
        (
            GIT_STUB_TEMPLATE.format(""),
            {"PW_ELEMENTS_COMMIT": "abc", "PW_ELEMENTS_DIRTY": "0"},
            None,
        ),
        (
            GIT_STUB_TEMPLATE.format(" M run"),
            {"PW_ELEMENTS_COMMIT": "abc", "PW_ELEMENTS_DIRTY": "1"},
            "2",
        ),
        ("exit 128", {}, None),
    ],
)
def test_commit_local_changes_and_threads_are_passed_on(tmp_path, git, expected, threads):
    """The script passes on the commit, local changes and the number of threads.

    A shell script replaces git. The default is one thread.
    """
    (tmp_path / "git").write_text(f"#!/bin/sh\n{git}\n")
    (tmp_path / "git").chmod(0o755)
    unset = dict.fromkeys(("PW_ELEMENTS_COMMIT", "PW_ELEMENTS_DIRTY"))
    path = f"{tmp_path}:{os.environ['PATH']}"
    variables = read_environment_of_started_command(PATH=path, OMP_NUM_THREADS=threads, **unset)
    assert {k: v for k, v in variables.items() if k.startswith("PW_ELEMENTS_")} == expected
    assert variables["OMP_NUM_THREADS"] == (threads or "1")


def test_folders_outside_the_project_can_be_written():
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        (Path(folder) / "result").write_text("kept")
    if IS_IN_UNPACKED_DEBIAN:
        points = list_mount_points()
        assert "/var" in points
        assert "/tmp" in points


@only_in_unpacked_debian
def test_the_unpacked_debian_is_read_only():
    for folder in ("/usr", "/etc"):
        with pytest.raises(OSError, match="Read-only"):
            tempfile.mkdtemp(dir=folder)


@only_in_unpacked_debian
def test_no_folder_is_mounted_twice():
    """No folder is mounted twice in the unpacked Debian.

    The cache folder is itself a mount, and rm -r on this folder must not reach other mounts below
    it.
    """
    assert [p for p in list_mount_points() if p.endswith("/usr/private")] == ["/usr/private"]


@pytest.mark.skipif(not shutil.which("shellcheck"), reason="shellcheck is not installed")
def test_shell_scripts_pass_shellcheck():
    process = subprocess.run(
        [
            "shellcheck",
            "run",
            ".ci/run",
            ".ci/build",
            ".ci/nightly",
            ".ci/package",
            ".ci/user-elements",
            ".ci/signals.sh",
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stdout
