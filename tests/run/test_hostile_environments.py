"""In unusual environments, the study ends with its results or with a reason in one line.

The tests run nightly, with one section of the real study. Tests of environments that cannot be
created on this machine are skipped, and the reason is given.
"""

import ctypes
import os
import re
import resource
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from study.run.store import Results

ROOT = Path(__file__).parents[2]
RUN_SCRIPT = ROOT / "run"
STUDY_CASES = ["7.1/pw-T6", "7.1/galerkin-T6"]
ERROR_LINE_PATTERN = re.compile(r"(run|study|figures|site|7\.1/[\w-]+): \S.*")
NAME_WITH_SPECIAL_CHARACTERS = "a b'c\"ü$x"

pytestmark = pytest.mark.random


@pytest.fixture(autouse=True)
def skip_unless_nightly(request):
    """Skip the tests of this module unless the option --nightly is given."""
    if not request.config.getoption("--nightly"):
        pytest.skip("with --nightly")


READ_ONLY_MOUNT_FLAG, BIND_MOUNT_FLAG, REMOUNT_FLAG, RECURSIVE_PRIVATE_MOUNT_FLAGS = (
    1,
    4096,
    32,
    0x40000 | 16384,
)  # flags of mount(2)


@dataclass(frozen=True)
class Mount:
    """A mount on a folder: an empty file system in memory, or a bind mount of the folder itself."""

    folder: Path
    flags: int = 0
    size: str = "64k"

    def mount_file_system(self):
        """Mount the file system, or raise OSError."""
        folder, bind = str(self.folder).encode(), self.flags & BIND_MOUNT_FLAG
        flags = self.flags | (REMOUNT_FLAG if bind and self.flags & READ_ONLY_MOUNT_FLAG else 0)
        kind, options = (folder, None) if bind else (b"tmpfs", f"size={self.size}".encode())
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mount(kind, folder, None if bind else b"tmpfs", flags, options):
            raise OSError(ctypes.get_errno(), "mount")


def skip_if_mounts_are_forbidden():
    """Skip the test if this process is not allowed to create mounts."""
    code = "import os; os.unshare(os.CLONE_NEWNS)"
    if subprocess.run([sys.executable, "-c", code], capture_output=True).returncode:
        pytest.skip("this machine cannot create mounts: they need root, and Python 3.12")


def run_study(
    results_folder,
    *arguments,
    command_prefix=(),
    mounts=(),
    resource_limits=(),
    script=RUN_SCRIPT,
    cwd=ROOT,
    **environment_changes,
):
    """Run the study of two cases, and return the process.

    The keyword arguments `environment_changes` are environment variables; a variable given as None
    is unset.
    """
    environment = {k: v for k, v in {**os.environ, **environment_changes}.items() if v is not None}

    if mounts:
        skip_if_mounts_are_forbidden()

    def set_mounts_and_limits():
        if mounts:
            os.unshare(os.CLONE_NEWNS)
            ctypes.CDLL(None).mount(b"none", b"/", None, RECURSIVE_PRIVATE_MOUNT_FLAGS, None)
        for mount in mounts:
            mount.mount_file_system()
        for resource_name, value in resource_limits:
            resource.setrlimit(resource_name, (value, value))

    return subprocess.run(
        [
            *command_prefix,
            script,
            "study",
            *(arguments or STUDY_CASES),
            "--out",
            str(results_folder),
        ],
        cwd=cwd,
        env=environment,
        preexec_fn=set_mounts_and_limits,
        capture_output=True,
        text=True,
        errors="replace",
    )


def assert_study_complete(process, results_folder):
    """Assert that a process has ended with status 0 and that its results are complete."""
    assert process.returncode == 0, process.stderr
    results = Results(results_folder)
    assert [case in results for case in STUDY_CASES] == [True, True]
    assert "Traceback" not in process.stderr


def assert_study_complete_or_reason_given(process, results_folder):
    """Assert that the results are complete, or that the last message of the process is a reason."""
    if process.returncode == 0:
        assert_study_complete(process, results_folder)
        return
    assert 0 < process.returncode < 128, process.stderr
    assert "Traceback" not in process.stderr, process.stderr
    assert ERROR_LINE_PATTERN.fullmatch(process.stderr.splitlines()[-1]), process.stderr


def test_a_full_file_system_gives_an_error_without_traceback(tmp_path):
    out = tmp_path / "full"
    out.mkdir()
    process = run_study(out, mounts=[Mount(out, size="4k")])
    assert "Traceback" not in process.stderr
    assert "No space left on device" in process.stderr
    assert process.returncode in (1, 2)


def test_a_full_temporary_folder_gives_results_or_a_reason(tmp_path):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    mounts = [Mount(temporary, size="4k")]
    process = run_study(tmp_path / "out", mounts=mounts, TMPDIR=str(temporary))
    assert_study_complete_or_reason_given(process, tmp_path / "out")


def test_read_only_shared_memory_gives_results_or_a_reason(tmp_path):
    """With a read-only folder /dev/shm, the study gives results or a reason."""
    mounts = [Mount(Path("/dev/shm"), READ_ONLY_MOUNT_FLAG)]
    variable = {"OMPI_MCA_btl_sm_backing_directory": None}
    process = run_study(tmp_path / "out", mounts=mounts, **variable)
    assert_study_complete_or_reason_given(process, tmp_path / "out")


def test_read_only_results_are_refused_and_a_read_only_clone_works(tmp_path):
    """Read-only results cause an error, but a read-only clone can write results elsewhere."""
    out = tmp_path / "read-only"
    out.mkdir()
    process = run_study(out, mounts=[Mount(out, READ_ONLY_MOUNT_FLAG)])
    assert (process.returncode, process.stdout) == (2, "")
    assert process.stderr == f"study: {out} cannot be written to: Read-only file system\n"
    process = run_study(
        tmp_path / "out",
        mounts=[Mount(ROOT, BIND_MOUNT_FLAG), Mount(ROOT, BIND_MOUNT_FLAG | READ_ONLY_MOUNT_FLAG)],
    )
    assert_study_complete(process, tmp_path / "out")


def test_two_studies_at_once_in_one_folder_both_complete(tmp_path):
    out = tmp_path / "out"
    command = [RUN_SCRIPT, "study", *STUDY_CASES, "--force", "--out", str(out)]
    processes = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    messages = [process.communicate()[1] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], messages
    assert_study_complete(run_study(out), out)
    assert [path.name for path in out.rglob(".*")] == [".pw-elements"]  # marks a results folder


@pytest.mark.parametrize("files", [16, 24, 64])
def test_few_open_files_give_results_or_a_reason(tmp_path, files):
    process = run_study(tmp_path / "out", resource_limits=[(resource.RLIMIT_NOFILE, files)])
    assert_study_complete_or_reason_given(process, tmp_path / "out")


@pytest.mark.parametrize("megabytes", [1200, 3000])
def test_limited_memory_gives_results_or_a_reason(tmp_path, megabytes):
    process = run_study(tmp_path / "out", resource_limits=[(resource.RLIMIT_AS, megabytes << 20)])
    assert_study_complete_or_reason_given(process, tmp_path / "out")


@pytest.mark.parametrize("megabytes", [300, 600])
@pytest.mark.parametrize("command", [(RUN_SCRIPT, "study"), (sys.executable, "-m", "study")])
def test_insufficient_memory_is_refused(tmp_path, command, megabytes):
    """The study is refused if memory is so small that OpenBLAS would wait for it forever."""
    size = megabytes << 20
    process = subprocess.run(
        [*command, *STUDY_CASES, "--out", str(tmp_path / "out")],
        cwd=ROOT,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size)),
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert process.returncode in (1, 2)
    assert re.fullmatch(
        rf"(run|study): a process is allowed {megabytes} MB of memory, and needs 1024: "
        r"allow them by ulimit -v 1048576\n",
        process.stderr,
    )


def test_results_from_the_future_remain_valid(tmp_path):
    """Results whose files have a time in the future remain valid.

    The clock may have been set back after they were written.
    """
    out = tmp_path / "out"
    assert_study_complete(run_study(out), out)
    later = time.time() + 1e8
    for path in out.rglob("*"):
        os.utime(path, (later, later))
    process = run_study(out)
    assert_study_complete(process, out)
    assert "2 of 2 results are reused" in process.stderr


@pytest.mark.parametrize("locale", ["tr_TR.UTF-8", "de_DE.UTF-8", "tr_TR.ISO-8859-9", "C", "none"])
def test_the_study_completes_in_any_locale(tmp_path, locale):
    """The study completes in any locale, even in one that is not installed."""
    process = run_study(tmp_path / "out", LC_ALL=locale, LANG=locale, LC_NUMERIC=locale)
    assert_study_complete(process, tmp_path / "out")


@pytest.mark.parametrize("mask", [0o000, 0o077])
def test_results_have_the_permissions_of_the_umask(tmp_path, mask):
    old_mask = os.umask(mask)
    try:
        process = run_study(tmp_path / "out")
    finally:
        os.umask(old_mask)
    assert_study_complete(process, tmp_path / "out")
    for path in (tmp_path / "out" / "7.1").iterdir():
        assert path.stat().st_mode & 0o777 == 0o666 & ~mask, path


@pytest.mark.parametrize("home", [None, "", "/nonexistent"])
def test_a_missing_home_folder_gives_results_or_a_reason(tmp_path, home):
    process = run_study(tmp_path / "out", HOME=home, XDG_CACHE_HOME=None, XDG_CONFIG_HOME=None)
    assert_study_complete_or_reason_given(process, tmp_path / "out")


def test_names_with_spaces_quotes_and_umlauts_are_supported(tmp_path):
    """Names with spaces, quotes and umlauts are supported.

    The folder of results, the current folder, the project's folder and TMPDIR have such names.
    """
    folder, project = (
        tmp_path / NAME_WITH_SPECIAL_CHARACTERS,
        tmp_path / f"project {NAME_WITH_SPECIAL_CHARACTERS}",
    )
    (folder / "temporary").mkdir(parents=True)
    ignored = shutil.ignore_patterns(".git", "results*", ".cache", "__pycache__")
    shutil.copytree(ROOT, project, ignore=ignored)
    options = {"cwd": folder, "TMPDIR": str(folder / "temporary"), "PYTHONPATH": None}
    process = run_study(NAME_WITH_SPECIAL_CHARACTERS, script=project / "run", **options)
    assert_study_complete(process, folder / NAME_WITH_SPECIAL_CHARACTERS)
    figure = subprocess.run(
        [
            project / "run",
            "figure",
            "fig05",
            "--results",
            NAME_WITH_SPECIAL_CHARACTERS,
            "--out",
            f"drawn {NAME_WITH_SPECIAL_CHARACTERS}",
        ],
        cwd=folder,
        env={k: v for k, v in os.environ.items() if k != "PYTHONPATH"},
        capture_output=True,
        text=True,
    )
    assert figure.returncode == 0, figure.stderr
    assert (folder / f"drawn {NAME_WITH_SPECIAL_CHARACTERS}" / "fig05.png").exists()


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-"])
def test_the_study_completes_with_closed_streams(tmp_path, closed):
    """The study completes even if a standard stream is closed, as in commands of some daemons."""
    out = tmp_path / "out"
    line = f'exec "$@" {closed}'
    process = run_study(out, command_prefix=["sh", "-c", line, "sh"])
    assert "Traceback" not in process.stderr
    results = Results(out)
    assert [case in results for case in STUDY_CASES] == [True, True], process.stderr


def test_modules_of_another_project_in_the_current_folder_are_not_imported(tmp_path):
    (tmp_path / "study.py").write_text("raise SystemExit('not this one')\n")
    (tmp_path / "numpy.py").write_text("raise SystemExit('nor this one')\n")
    process = run_study(tmp_path / "out", cwd=tmp_path)
    assert_study_complete(process, tmp_path / "out")
