"""Commands as they are started: signals and kills, at moments that nobody chose."""

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
from tests.run.processes import SIGNALS, Started, command_line
from tests.study.toystudy import install

ROOT = Path(__file__).parents[2]
RUN = ROOT / "run"
SECTIONS = ["7.1", "V1"]
KILLS = 50
SIGNALLED = {"study": 30, "figure": 30, "site": 20}
# as ./run does it: signals wait until the supervisor is there
BLOCKING = ["env", *(f"--block-signal={one.name.removeprefix('SIG')}" for one in SIGNALS)]
SUPERVISED = [*BLOCKING, sys.executable, "-m", "study.core.supervisor"]
TOLD = re.compile(r"\w+: interrupted by (SIG\w+)( before the command began)?(; .*|$)")


class Run(Started):
    """The study in processes of its own, and what that leaves behind."""

    def __init__(self, out, *arguments, **environment):
        command = [*SUPERVISED, "study", *arguments, "--jobs", "2", "--out", str(out)]
        messages = out.with_name(f"{out.name}.err")
        super().__init__(command, messages, PYTHONPATH=str(ROOT), **environment)

    def workers(self):
        return [one for one in self.below() if "spawn_main" in command_line(one)]

    def killable(self):
        """Return leader, guard, main process and workers, but no compiler and no helper."""
        ours = [one for one in self.below() if "-m study.core.supervisor" in command_line(one)]
        return [self.pid, *ours, *self.workers()]


def numbers(out):
    """Return all that is stored, as text: gaps in curves are equal then."""
    results = Results(out)
    return {
        case.key: repr((case.scalars, {key: curve.tolist() for key, curve in case.curves.items()}))
        for section in SECTIONS
        for case in results.section(section)
    }


def commands(folder):
    """Return what is interrupted: computes, draws and makes pages."""
    out = str(folder / "results")
    return {
        "study": [RUN, "study", "3", "--force", "--jobs", "2", "--out", out],
        "figure": [RUN, "figure", "fig05", "--results", out, "--out", str(folder / "drawn")],
        "site": [
            *SUPERVISED,
            "study.site",
            "--results",
            out,
            "--out",
            str(folder / "site"),
            "--jobs",
            "2",
        ],
    }


@pytest.mark.random
@pytest.mark.parametrize("name", SIGNALLED)
def test_a_signal_at_any_moment_is_one_line_and_leaves_nobody(tmp_path, request, name):
    """Whatever the command is doing, from the first moment on; files of others stay."""
    if not request.config.getoption("--nightly"):
        pytest.skip("with --nightly")
    first = commands(tmp_path)["study"]  # makes the folder one of results
    assert subprocess.run(first, capture_output=True, cwd=ROOT).returncode in (0, 1)
    (tmp_path / "drawn").mkdir()
    for folder in ("results", "results/3", "drawn"):
        (tmp_path / folder / ".mine").write_text("mine")
    for _ in range(SIGNALLED[name]):
        number, group = random.choice(SIGNALS), random.random() < 0.5
        before = numbers(tmp_path / "results")
        command = commands(tmp_path)[name]
        with Started(command, tmp_path / "messages", PYTHONPATH=str(ROOT)) as run:
            time.sleep(random.uniform(0.0, 8.0))
            for _ in range(random.choice([1, 2])):
                run.send(number, group)
            status = run.wait()
            assert run.left() == []
            told = [found for line in run.lines() if (found := TOLD.fullmatch(line))]
            assert not [line for line in run.lines() if "Traceback" in line], run.lines()
            if status in (0, 1):  # it had ended, or was ending
                assert told == []
            elif status == 128 + number:
                assert [found[1] for found in told] == [number.name]
                assert TOLD.fullmatch(run.lines()[-1])
            else:  # while the shell handed over to the command it may be silent
                assert status == -number, run.lines()
                assert len(told) <= 1
        after = numbers(tmp_path / "results")
        assert {key: after.get(key) for key in before} == before
    for folder in ("results", "results/3", "drawn"):
        assert (tmp_path / folder / ".mine").read_text() == "mine"


def test_interrupt_keeps_what_there_is_and_a_killed_main_process_takes_its_workers_along(tmp_path):
    out = tmp_path / "results"
    with Run(out, "V1") as run:
        while not (before := [path.name for path in out.rglob("[!.]*.json")]):
            assert run.process.poll() is None
            time.sleep(0.02)
        run.send(signal.SIGINT, group=True)
        assert run.wait() == 130
        assert TOLD.fullmatch(run.lines()[-1])[1] == "SIGINT"
        assert run.left() == []
    assert {*before} <= {f"{key.partition('/')[2]}.json" for key in numbers(out)}
    with Run(out, "V1", "--force") as run:
        while not run.workers():
            time.sleep(0.02)
        run.process.kill()
        run.wait()
        assert run.left_in_the_end() == []


@pytest.mark.random
def test_random_kills_lose_nothing_and_leave_nobody(tmp_path, request):
    """Leader, guard, main process or worker, at random; half of the results is computed each time.

    Now and then without compiled forms: a compilation that is killed would block its form.
    """
    if not request.config.getoption("--nightly"):
        pytest.skip("takes ten minutes, with --nightly")
    whole, out = tmp_path / "whole", tmp_path / "results"
    start = time.monotonic()
    with Run(whole, *SECTIONS) as run:
        assert run.wait() == 0, run.lines()
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
        with Run(out, *SECTIONS, *random.choice([["--force"], []]), **compiled) as run:
            time.sleep(random.uniform(0.0, seconds))
            victim = random.choice(run.killable())
            killed = run.process.poll() is None
            with suppress(ProcessLookupError):  # it has just ended
                os.kill(victim, signal.SIGKILL)
            status = run.wait()
            ended += [status] * killed
            assert status in (0, 1, -signal.SIGKILL, 128 + signal.SIGKILL), run.lines()
            assert run.left_in_the_end() == []
            bad = [line for line in run.lines() if re.search("failed|Traceback", line)]
            assert not bad, run.lines()
        after = numbers(out)
        assert {key: after.get(key) for key in before} == before
    assert set(ended) >= {1, 128 + signal.SIGKILL}  # workers with a case, and main processes
    with Run(out, *SECTIONS, **compiled) as run:
        assert run.wait() == 0, run.lines()
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
