"""The study where something is missing or odd: it ends with a result, or says why in one sentence.

Nightly, on one real section. Places that this machine cannot make are skipped, with the reason.
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

from study.core.store import Results

ROOT = Path(__file__).parents[2]
RUN = ROOT / "run"
CASES = ["7.1/pw-T6", "7.1/galerkin-T6"]
SENTENCE = re.compile(r"(run|study|figures|site|7\.1/[\w-]+): \S.*")
ODD = "a b'c\"ü$x"

pytestmark = pytest.mark.random


@pytest.fixture(autouse=True)
def nightly(request):
    if not request.config.getoption("--nightly"):
        pytest.skip("with --nightly")


READ_ONLY, BIND, REMOUNT, PRIVATE = 1, 4096, 32, 0x40000 | 16384  # flags of mount(2)


@dataclass(frozen=True)
class Mount:
    """A file system, empty and in memory, or the folder itself once more, in a folder."""

    folder: Path
    flags: int = 0
    size: str = "64k"

    def make(self):
        folder, bind = str(self.folder).encode(), self.flags & BIND
        flags = self.flags | (REMOUNT if bind and self.flags & READ_ONLY else 0)
        kind, options = (folder, None) if bind else (b"tmpfs", f"size={self.size}".encode())
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mount(kind, folder, None if bind else b"tmpfs", flags, options):
            raise OSError(ctypes.get_errno(), "mount")


def ensure_mounts():
    """Skip where this process may not have mounts of its own."""
    code = "import os; os.unshare(os.CLONE_NEWNS)"
    if subprocess.run([sys.executable, "-c", code], capture_output=True).returncode:
        pytest.skip("this machine makes no such place: mounts need root, and Python 3.12")


def study(out, *arguments, wrapped=(), mounts=(), limits=(), script=RUN, cwd=ROOT, **changes):
    """Return the finished study of two cases; a variable given as None is unset."""
    environment = {k: v for k, v in {**os.environ, **changes}.items() if v is not None}

    if mounts:
        ensure_mounts()

    def limit():
        if mounts:
            os.unshare(os.CLONE_NEWNS)
            ctypes.CDLL(None).mount(b"none", b"/", None, PRIVATE, None)
        for one in mounts:
            one.make()
        for what, value in limits:
            resource.setrlimit(what, (value, value))

    return subprocess.run(
        [*wrapped, script, "study", *(arguments or CASES), "--out", str(out)],
        cwd=cwd,
        env=environment,
        preexec_fn=limit,
        capture_output=True,
        text=True,
        errors="replace",
    )


def ensure_complete(done, out):
    assert done.returncode == 0, done.stderr
    found = Results(out)
    assert [case in found for case in CASES] == [True, True]
    assert "Traceback" not in done.stderr


def ensure_complete_or_explained(done, out):
    """Complete, or a status above 0 and sentences that end with the reason."""
    if done.returncode == 0:
        ensure_complete(done, out)
        return
    assert 0 < done.returncode < 128, done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    assert SENTENCE.fullmatch(done.stderr.splitlines()[-1]), done.stderr


def test_results_on_a_full_file_system(tmp_path):
    out = tmp_path / "full"
    out.mkdir()
    done = study(out, mounts=[Mount(out, size="4k")])
    assert "Traceback" not in done.stderr
    assert "No space left on device" in done.stderr
    assert done.returncode in (1, 2)


def test_full_folder_of_temporary_files(tmp_path):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    mounts = [Mount(temporary, size="4k")]
    done = study(tmp_path / "out", mounts=mounts, TMPDIR=str(temporary))
    ensure_complete_or_explained(done, tmp_path / "out")


def test_no_shared_memory(tmp_path):
    """Nothing can be written in /dev/shm."""
    mounts = [Mount(Path("/dev/shm"), READ_ONLY)]
    variable = {"OMPI_MCA_btl_sm_backing_directory": None}
    done = study(tmp_path / "out", mounts=mounts, **variable)
    ensure_complete_or_explained(done, tmp_path / "out")


def test_read_only_results_and_clone(tmp_path):
    """Results have to go elsewhere then, and can."""
    out = tmp_path / "read-only"
    out.mkdir()
    done = study(out, mounts=[Mount(out, READ_ONLY)])
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"study: {out} cannot be written to: Read-only file system\n"
    done = study(tmp_path / "out", mounts=[Mount(ROOT, BIND), Mount(ROOT, BIND | READ_ONLY)])
    ensure_complete(done, tmp_path / "out")


def test_two_at_once_in_one_folder(tmp_path):
    out = tmp_path / "out"
    command = [RUN, "study", *CASES, "--force", "--out", str(out)]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    told = [one.communicate()[1] for one in both]
    assert [one.returncode for one in both] == [0, 0], told
    ensure_complete(study(out), out)
    assert [path.name for path in out.rglob(".*")] == [".pw-elements"]  # the mark of the folder


@pytest.mark.parametrize("files", [16, 24, 64])
def test_few_open_files(tmp_path, files):
    done = study(tmp_path / "out", limits=[(resource.RLIMIT_NOFILE, files)])
    ensure_complete_or_explained(done, tmp_path / "out")


@pytest.mark.parametrize("megabytes", [1200, 3000])
def test_little_memory(tmp_path, megabytes):
    done = study(tmp_path / "out", limits=[(resource.RLIMIT_AS, megabytes << 20)])
    ensure_complete_or_explained(done, tmp_path / "out")


@pytest.mark.parametrize("megabytes", [300, 600])
@pytest.mark.parametrize("command", [(RUN, "study"), (sys.executable, "-m", "study")])
def test_too_little_memory(tmp_path, command, megabytes):
    """It is refused before OpenBLAS waits for memory without end."""
    size = megabytes << 20
    done = subprocess.run(
        [*command, *CASES, "--out", str(tmp_path / "out")],
        cwd=ROOT,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size)),
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode in (1, 2)
    assert re.fullmatch(
        rf"(run|study): a process is allowed {megabytes} MB of memory, and needs 1024: "
        r"allow them by ulimit -v 1048576\n",
        done.stderr,
    )


def test_clock_set_back(tmp_path):
    """Results seem to come from the future then, and hold."""
    out = tmp_path / "out"
    ensure_complete(study(out), out)
    later = time.time() + 1e8
    for path in out.rglob("*"):
        os.utime(path, (later, later))
    done = study(out)
    ensure_complete(done, out)
    assert "2 of 2 results are reused" in done.stderr


@pytest.mark.parametrize("locale", ["tr_TR.UTF-8", "de_DE.UTF-8", "tr_TR.ISO-8859-9", "C", "none"])
def test_locales(tmp_path, locale):
    """Whether the system has them or not."""
    done = study(tmp_path / "out", LC_ALL=locale, LANG=locale, LC_NUMERIC=locale)
    ensure_complete(done, tmp_path / "out")


@pytest.mark.parametrize("mask", [0o000, 0o077])
def test_umask(tmp_path, mask):
    """Permissions of results are those that the user asks for."""
    before = os.umask(mask)
    try:
        done = study(tmp_path / "out")
    finally:
        os.umask(before)
    ensure_complete(done, tmp_path / "out")
    for path in (tmp_path / "out" / "7.1").iterdir():
        assert path.stat().st_mode & 0o777 == 0o666 & ~mask, path


@pytest.mark.parametrize("home", [None, "", "/nonexistent"])
def test_no_home(tmp_path, home):
    done = study(tmp_path / "out", HOME=home, XDG_CACHE_HOME=None, XDG_CONFIG_HOME=None)
    ensure_complete_or_explained(done, tmp_path / "out")


def test_names_with_spaces_quotes_and_umlauts(tmp_path):
    """Of results, of the folder in which the command is called, of the project and of TMPDIR."""
    here, project = tmp_path / ODD, tmp_path / f"project {ODD}"
    (here / "temporary").mkdir(parents=True)
    kept = shutil.ignore_patterns(".git", "results*", ".cache", "__pycache__")
    shutil.copytree(ROOT, project, ignore=kept)
    options = {"cwd": here, "TMPDIR": str(here / "temporary"), "PYTHONPATH": None}
    done = study(ODD, script=project / "run", **options)
    ensure_complete(done, here / ODD)
    figure = subprocess.run(
        [project / "run", "figure", "fig05", "--results", ODD, "--out", f"drawn {ODD}"],
        cwd=here,
        env={k: v for k, v in os.environ.items() if k != "PYTHONPATH"},
        capture_output=True,
        text=True,
    )
    assert figure.returncode == 0, figure.stderr
    assert (here / f"drawn {ODD}" / "fig05.png").exists()


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-"])
def test_closed_streams(tmp_path, closed):
    """As under some daemons."""
    out = tmp_path / "out"
    line = f'exec "$@" {closed}'
    done = study(out, wrapped=["sh", "-c", line, "sh"])
    assert "Traceback" not in done.stderr
    found = Results(out)
    assert [case in found for case in CASES] == [True, True], done.stderr


def test_python_of_another_project_in_front(tmp_path):
    """Modules in the folder of the call do not stand in for those of the project."""
    (tmp_path / "study.py").write_text("raise SystemExit('not this one')\n")
    (tmp_path / "numpy.py").write_text("raise SystemExit('nor this one')\n")
    done = study(tmp_path / "out", cwd=tmp_path)
    ensure_complete(done, tmp_path / "out")
