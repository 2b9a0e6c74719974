"""The study as it is started: Ctrl-C and kills, at moments that nobody chose."""

import multiprocessing
import os
import random
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from study.command import main
from study.core.jit import unblocked
from study.core.pool import _work
from study.core.store import Results, sweep
from tests.study.toystudy import install

ROOT = Path(__file__).parents[2]
SECTIONS = ["7.1", "V1"]
KILLS = 50
INTERRUPTED = "study: interrupted; the results so far are kept"
START = [sys.executable, "-X", "importtime", "-m", "study"]
IMPORTED = "import time:"  # that is what Python tells of each import then


class Run:
    """The study in a process of its own, and what that leaves behind."""

    def __init__(self, out, *arguments, **environment):
        self.errors = out.with_name(f"{out.name}.err")
        with self.errors.open("wb") as errors:
            self.process = subprocess.Popen(
                [*START, *arguments, "--jobs", "2", "--out", str(out)],
                cwd=ROOT,
                env=os.environ | environment,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
            )
        while "study.core.interrupt" not in self.errors.read_text():
            assert self.process.poll() is None
            time.sleep(0.005)

    def told(self):
        lines = self.errors.read_text().splitlines()
        return [line for line in lines if not line.startswith(IMPORTED)]

    def processes(self):
        found = []
        for folder in Path("/proc").iterdir():
            try:
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == self.process.pid and fields[0] != "Z":
                found.append(int(folder.name))
        return found

    def workers(self):
        found = []
        for process in self.processes():
            with suppress(OSError):  # it has just ended
                if b"spawn_main" in Path(f"/proc/{process}/cmdline").read_bytes():
                    found.append(process)
        return found

    def wait(self, seconds=1800):
        return self.process.wait(seconds)

    def survivors(self):
        """Return the processes that are there some time after the main one."""
        deadline = time.monotonic() + 600
        while (left := self.processes()) and time.monotonic() < deadline:
            time.sleep(0.05)
        return left


def numbers(out):
    """Return all that is stored, as text: gaps in curves are equal then."""
    results = Results(out)
    return {
        case.key: repr((case.scalars, {key: curve.tolist() for key, curve in case.curves.items()}))
        for section in SECTIONS
        for case in results.section(section)
    }


@pytest.mark.random
def test_interrupt_at_any_moment_is_one_line(tmp_path, request):
    if not request.config.getoption("--nightly"):
        pytest.skip("with --nightly")
    for _ in range(80):
        run = Run(tmp_path / "results", "3", "--force")
        time.sleep(random.uniform(0.0, 4.0))
        for _ in range(random.choice([1, 2])):  # as a terminal does, which means the workers, too
            os.killpg(run.process.pid, signal.SIGINT)
        status = run.wait()
        assert not run.survivors()
        assert not [line for line in run.told() if "Traceback" in line], run.told()
        assert status == 0 or (status, run.told()[-1]) == (130, INTERRUPTED)


def test_interrupt_keeps_what_there_is_and_a_killed_main_process_takes_its_workers_along(tmp_path):
    out = tmp_path / "results"
    run = Run(out, "V1")
    while not (before := [path.name for path in out.rglob("[!.]*.json")]):
        assert run.process.poll() is None
        time.sleep(0.02)
    os.killpg(run.process.pid, signal.SIGINT)
    assert (run.wait(), run.told()[-1]) == (130, INTERRUPTED)
    assert not run.survivors()
    assert {*before} <= {f"{key.partition('/')[2]}.json" for key in numbers(out)}
    run = Run(out, "V1", "--force")
    while not run.workers():
        time.sleep(0.02)
    run.process.kill()
    run.wait()
    assert not run.survivors()


@pytest.mark.random
def test_random_kills_lose_nothing_and_leave_nobody(tmp_path, request):
    """Main process or worker, at random; half of the results is to be computed each time.

    Now and then without compiled forms: a compilation that is killed would block its form.
    """
    if not request.config.getoption("--nightly"):
        pytest.skip("takes ten minutes, with --nightly")
    whole, out = tmp_path / "whole", tmp_path / "results"
    start = time.monotonic()
    run = Run(whole, *SECTIONS)
    assert run.wait() == 0, run.told()
    seconds, expected = time.monotonic() - start, numbers(whole)
    ended, attempt = [], 0
    while len(ended) < KILLS:
        if attempt % 10 == 0:
            compiled = {"XDG_CACHE_HOME": str(tmp_path / f"compiled-{attempt}")}
        attempt += 1
        for path in list(out.rglob("[!.]*.json")):
            if random.random() < 0.5 and path.parent.name in SECTIONS:
                path.unlink()
        before = numbers(out)
        run = Run(out, *SECTIONS, *random.choice([["--force"], []]), **compiled)
        time.sleep(random.uniform(0.0, seconds))
        victim = random.choice([run.process.pid, *run.workers()])
        killed = run.process.poll() is None
        with suppress(ProcessLookupError):  # it has just ended
            os.kill(victim, signal.SIGKILL)
        status = run.wait()
        ended += [status] * killed
        assert status in (0, 1, -signal.SIGKILL), run.told()
        assert not run.survivors()
        assert not [line for line in run.told() if re.search("failed|Traceback", line)], run.told()
        after = numbers(out)
        assert {key: after.get(key) for key in before} == before
    assert set(ended) >= {1, -signal.SIGKILL}  # workers with a case, and main processes
    run = Run(out, *SECTIONS, **compiled)
    assert run.wait() == 0, run.told()
    assert numbers(out) == expected
    assert [path.name for path in out.rglob(".*")] == [".pw-elements"]


def test_a_worker_whose_main_process_has_gone_says_nothing():
    ours, theirs = multiprocessing.Pipe()
    ours.send(("math:sqrt", (4.0,)))
    ours.close()
    _work(theirs)  # and nobody takes what it has done


def test_what_killed_writers_leave_is_swept_in_the_folders_of_results(tmp_path):
    left = ".0123456789abcdef.pw-elements-unfinished"
    deep = tmp_path / "7.1" / "deeper"
    deep.mkdir(parents=True)
    for folder in (tmp_path, tmp_path / "7.1", deep):
        (folder / left).write_text("")
    sweep(tmp_path)
    assert [path.name for path in tmp_path.rglob(".*")] == [left]
    assert (deep / left).exists()


def waiting_for(source):
    return TimeoutError(
        "JIT compilation timed out, probably due to a failed previous compile. "
        f"Try cleaning cache (e.g. remove {source}) or increase timeout option."
    )


@pytest.fixture
def source(tmp_path):
    """C code of a form whose compilation began long ago."""
    path = tmp_path / "libffcx_forms_1f.c"
    path.write_text("")
    os.utime(path, (0, 0))
    return path


def test_compilations_that_were_killed_or_made_twice_are_made_again(source):
    """But one that is slow is waited for, and other errors block nothing."""
    compiled, done = source.with_suffix(".o"), source.with_suffix(".c.cached")
    compiled.write_text("just made")
    assert unblocked(waiting_for(source))
    assert not unblocked(TimeoutError("of another kind"))
    assert not unblocked(FileExistsError(17, "File exists", str(source)))
    assert source.exists()
    compiled.unlink()
    assert unblocked(waiting_for(source))
    assert not source.exists()
    source.write_text("")
    os.utime(source, (0, 0))
    assert unblocked(ValueError(f"the form cannot be compiled: {waiting_for(source)}"))
    assert not source.exists()
    done.touch()
    with pytest.raises(FileExistsError) as caught:
        done.open("x")
    assert unblocked(caught.value)
    assert not done.exists()


BLOCKED = """
from pathlib import Path
from tests.run.test_interrupted import waiting_for
def run(value, log, do=""):
    if do and Path(do).exists():
        raise waiting_for(do)
"""


def test_compilation_that_was_killed_costs_no_case(tmp_path, monkeypatch, source):
    install(tmp_path, monkeypatch)
    one = tmp_path / "toy" / "one.py"
    text = one.read_text().replace('def run(value, log, do=""):', BLOCKED.strip())
    one.write_text(text.replace('case("a")', f'case("a", do="{source}")'))
    monkeypatch.setattr("study.report.build", lambda *_: [])
    assert main(["1", "--jobs", "1", "--out", str(tmp_path / "results")]) == 0
    assert Results(tmp_path / "results").cases("1") == ["a", "b"]
