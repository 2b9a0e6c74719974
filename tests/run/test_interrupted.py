"""Whole commands that receive signals, or whose processes are killed, at random times."""

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

from study.publish.command import main
from study.run.jit import recover_from_jit_conflict
from study.run.pool import _run_tasks_until_channel_closes
from study.run.store import Results, remove_unfinished_files
from tests.run.processes import TERMINATION_SIGNALS, SpawnedCommand, read_command_line
from tests.study.toystudy import install_toy_study

ROOT = Path(__file__).parents[2]
RUN_SCRIPT = ROOT / "run"
STUDY_SECTIONS = ["7.1", "V1"]
N_RANDOM_KILLS = 50
N_SIGNALS_BY_COMMAND = {"study": 30, "figure": 30, "site": 20}
# as in ./run: signals are blocked until the supervisor runs
SIGNAL_BLOCKING_COMMAND = [
    "env",
    *(f"--block-signal={number.name.removeprefix('SIG')}" for number in TERMINATION_SIGNALS),
]
SUPERVISED_PYTHON_COMMAND = [*SIGNAL_BLOCKING_COMMAND, sys.executable, "-m", "study.run.supervisor"]
INTERRUPTION_MESSAGE_PATTERN = re.compile(
    r"\w+: interrupted by (SIG\w+)( before the command began)?(; .*|$)"
)


class SupervisedStudyCommand(SpawnedCommand):
    """The study under its supervisor, which runs in separate processes."""

    def __init__(self, out, *arguments, **environment):
        command = [
            *SUPERVISED_PYTHON_COMMAND,
            "study",
            *arguments,
            "--jobs",
            "2",
            "--out",
            str(out),
        ]
        messages = out.with_name(f"{out.name}.err")
        super().__init__(command, messages, PYTHONPATH=str(ROOT), **environment)

    def list_workers(self):
        return [
            process
            for process in self.list_descendants()
            if "spawn_main" in read_command_line(process)
        ]

    def list_killable_processes(self):
        """Return the IDs of leader, guard, main process and workers, without those of compilers."""
        supervised = [
            process
            for process in self.list_descendants()
            if "-m study.run.supervisor" in read_command_line(process)
        ]
        return [self.pid, *supervised, *self.list_workers()]


def read_stored_numbers(results_folder):
    """Return the scalars and curves of each case as text, so that NaN equals NaN."""
    results = Results(results_folder)
    return {
        case.key: repr((case.scalars, {key: curve.tolist() for key, curve in case.curves.items()}))
        for section in STUDY_SECTIONS
        for case in results.section(section)
    }


def make_interruptible_commands(folder):
    """Return the commands to be interrupted, which make results, a figure and the site."""
    results = str(folder / "results")
    return {
        "study": [RUN_SCRIPT, "study", "3", "--force", "--jobs", "2", "--out", results],
        "figure": [
            RUN_SCRIPT,
            "figure",
            "fig05",
            "--results",
            results,
            "--out",
            str(folder / "drawn"),
        ],
        "site": [
            *SUPERVISED_PYTHON_COMMAND,
            "study.publish.site",
            "--results",
            results,
            "--out",
            str(folder / "site"),
            "--jobs",
            "2",
        ],
    }


@pytest.mark.random
@pytest.mark.parametrize("name", N_SIGNALS_BY_COMMAND)
def test_a_signal_at_any_time_gives_one_line_and_leaves_no_process(tmp_path, request, name):
    """A signal at any time gives a message of one line and leaves no process.

    This holds for every phase of the command. Stored results and foreign files are kept.
    """
    if not request.config.getoption("--nightly"):
        pytest.skip("with --nightly")
    study_command = make_interruptible_commands(tmp_path)[
        "study"
    ]  # marks the folder as a results folder
    assert subprocess.run(study_command, capture_output=True, cwd=ROOT).returncode in (0, 1)
    (tmp_path / "drawn").mkdir()
    for folder in ("results", "results/3", "drawn"):
        (tmp_path / folder / ".mine").write_text("mine")
    for _ in range(N_SIGNALS_BY_COMMAND[name]):
        number, group = random.choice(TERMINATION_SIGNALS), random.random() < 0.5
        old_numbers = read_stored_numbers(tmp_path / "results")
        command = make_interruptible_commands(tmp_path)[name]
        with SpawnedCommand(command, tmp_path / "messages", PYTHONPATH=str(ROOT)) as process:
            time.sleep(random.uniform(0.0, 8.0))
            for _ in range(random.choice([1, 2])):
                process.send_signal(number, group)
            status = process.wait()
            assert process.list_survivors() == []
            interruptions = [
                match
                for line in process.read_messages()
                if (match := INTERRUPTION_MESSAGE_PATTERN.fullmatch(line))
            ]
            assert not [line for line in process.read_messages() if "Traceback" in line], (
                process.read_messages()
            )
            if status in (0, 1):  # the command had ended, or was about to end
                assert interruptions == []
            elif status == 128 + number:
                assert [match[1] for match in interruptions] == [number.name]
                assert INTERRUPTION_MESSAGE_PATTERN.fullmatch(process.read_messages()[-1])
            else:  # there is no message while the shell is replaced by the command
                assert status == -number, process.read_messages()
                assert len(interruptions) <= 1
        new_numbers = read_stored_numbers(tmp_path / "results")
        assert {key: new_numbers.get(key) for key in old_numbers} == old_numbers
    for folder in ("results", "results/3", "drawn"):
        assert (tmp_path / folder / ".mine").read_text() == "mine"


def test_an_interrupt_keeps_stored_results_and_workers_end_with_a_killed_main_process(tmp_path):
    out = tmp_path / "results"
    with SupervisedStudyCommand(out, "V1") as run:
        while not (stored_names := [path.name for path in out.rglob("[!.]*.json")]):
            assert run.process.poll() is None
            time.sleep(0.02)
        run.send_signal(signal.SIGINT, to_group=True)
        assert run.wait() == 130
        assert INTERRUPTION_MESSAGE_PATTERN.fullmatch(run.read_messages()[-1])[1] == "SIGINT"
        assert run.list_survivors() == []
    assert {*stored_names} <= {f"{key.partition('/')[2]}.json" for key in read_stored_numbers(out)}
    with SupervisedStudyCommand(out, "V1", "--force") as run:
        while not run.list_workers():
            time.sleep(0.02)
        run.process.kill()
        run.wait()
        assert run.list_survivors_after_waiting() == []


@pytest.mark.random
def test_random_kills_lose_no_result_and_leave_no_process(tmp_path, request):
    """Killing a random process loses no stored result and leaves no process.

    In each run, about half of the results are computed, and the leader, guard, main process or a
    worker is killed. Every tenth run starts without compiled forms, because a compilation that was
    killed may block its form.
    """
    if not request.config.getoption("--nightly"):
        pytest.skip("takes ten minutes, with --nightly")
    uninterrupted, out = tmp_path / "whole", tmp_path / "results"
    start = time.monotonic()
    with SupervisedStudyCommand(uninterrupted, *STUDY_SECTIONS) as run:
        assert run.wait() == 0, run.read_messages()
    seconds, expected = time.monotonic() - start, read_stored_numbers(uninterrupted)
    statuses, attempt = [], 0
    while len(statuses) < N_RANDOM_KILLS:
        if attempt % 10 == 0:
            cache = {"XDG_CACHE_HOME": str(tmp_path / f"compiled-{attempt}")}
        attempt += 1
        for path in list(out.rglob("[!.]*.json")):
            if random.random() < 0.5 and path.parent.name in STUDY_SECTIONS:
                path.unlink()
        old_numbers = read_stored_numbers(out)
        with SupervisedStudyCommand(
            out, *STUDY_SECTIONS, *random.choice([["--force"], []]), **cache
        ) as run:
            time.sleep(random.uniform(0.0, seconds))
            victim = random.choice(run.list_killable_processes())
            was_running = run.process.poll() is None
            with suppress(ProcessLookupError):  # the process may just have ended
                os.kill(victim, signal.SIGKILL)
            status = run.wait()
            statuses += [status] * was_running
            assert status in (0, 1, -signal.SIGKILL, 128 + signal.SIGKILL), run.read_messages()
            assert run.list_survivors_after_waiting() == []
            errors = [line for line in run.read_messages() if re.search("failed|Traceback", line)]
            assert not errors, run.read_messages()
        new_numbers = read_stored_numbers(out)
        assert {key: new_numbers.get(key) for key in old_numbers} == old_numbers
    # the statuses after a worker with a case, and after a main process, has been killed
    assert set(statuses) >= {1, 128 + signal.SIGKILL}
    with SupervisedStudyCommand(out, *STUDY_SECTIONS, **cache) as run:
        assert run.wait() == 0, run.read_messages()
    assert read_stored_numbers(out) == expected
    assert [path.name for path in out.rglob(".*")] == [".pw-elements"]


def test_a_worker_without_its_main_process_prints_nothing():
    main_end, worker_end = multiprocessing.Pipe()
    main_end.send(("math:sqrt", (4.0,)))
    main_end.close()
    _run_tasks_until_channel_closes(worker_end)  # no process receives the result


def test_unfinished_files_of_killed_writers_are_removed_from_results_folders(tmp_path):
    unfinished = ".0123456789abcdef.pw-elements-unfinished"
    deep = tmp_path / "7.1" / "deeper"
    deep.mkdir(parents=True)
    for folder in (tmp_path, tmp_path / "7.1", deep):
        (folder / unfinished).write_text("")
    remove_unfinished_files(tmp_path)
    assert [path.name for path in tmp_path.rglob(".*")] == [unfinished]
    assert (deep / unfinished).exists()


def make_compilation_timeout_error(form_source):
    """Return DOLFINx's error for a form whose compilation has been interrupted."""
    return TimeoutError(
        "JIT compilation timed out, probably due to a failed previous compile. "
        f"Try cleaning cache (e.g. remove {form_source}) or increase timeout option."
    )


@pytest.fixture
def abandoned_form_source(tmp_path):
    """Return the path of a form's C source whose compilation began long ago."""
    path = tmp_path / "libffcx_forms_1f.c"
    path.write_text("")
    os.utime(path, (0, 0))
    return path


def test_compilations_that_were_killed_or_duplicated_are_repeated(abandoned_form_source):
    """Compilations that were killed or started twice are repeated.

    A slow compilation is not repeated, and other errors do not count as blocked forms.
    """
    object_file, completion_mark = (
        abandoned_form_source.with_suffix(".o"),
        abandoned_form_source.with_suffix(".c.cached"),
    )
    object_file.write_text("just made")
    assert recover_from_jit_conflict(make_compilation_timeout_error(abandoned_form_source))
    assert not recover_from_jit_conflict(TimeoutError("of another kind"))
    assert not recover_from_jit_conflict(
        FileExistsError(17, "File exists", str(abandoned_form_source))
    )
    assert abandoned_form_source.exists()
    object_file.unlink()
    assert recover_from_jit_conflict(make_compilation_timeout_error(abandoned_form_source))
    assert not abandoned_form_source.exists()
    abandoned_form_source.write_text("")
    os.utime(abandoned_form_source, (0, 0))
    assert recover_from_jit_conflict(
        ValueError(
            f"the form cannot be compiled: {make_compilation_timeout_error(abandoned_form_source)}"
        )
    )
    assert not abandoned_form_source.exists()
    completion_mark.touch()
    with pytest.raises(FileExistsError) as caught:
        completion_mark.open("x")
    assert recover_from_jit_conflict(caught.value)
    assert not completion_mark.exists()


CASE_SOURCE_WITH_TIMEOUT = """
from pathlib import Path
from tests.run.test_interrupted import make_compilation_timeout_error
def run(value, log, do=""):
    if do and Path(do).exists():
        raise make_compilation_timeout_error(do)
"""


def test_a_killed_compilation_loses_no_case(tmp_path, monkeypatch, abandoned_form_source):
    install_toy_study(tmp_path, monkeypatch)
    section = tmp_path / "toy" / "one.py"
    text = section.read_text().replace(
        'def run(value, log, do=""):', CASE_SOURCE_WITH_TIMEOUT.strip()
    )
    section.write_text(text.replace('case("a")', f'case("a", do="{abandoned_form_source}")'))
    monkeypatch.setattr("study.publish.report.build_report", lambda *_: [])
    assert main(["1", "--jobs", "1", "--out", str(tmp_path / "results")]) == 0
    assert Results(tmp_path / "results").cases("1") == ["a", "b"]
