"""One supervisor for every command: no descendant survives a signal, which is told in one line."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from study.core.store import Results
from study.core.supervisor import KEPT
from tests.run.processes import SIGNALS, Started, command_line

ROOT = Path(__file__).parents[2]
RUN = ROOT / "run"

# A child; one that ignores all that can be ignored, with a child of its own; one that has left its
# parent and its session; and work that never looks at signals
FAMILY = """
import os, subprocess, sys, time
def command():
    subprocess.Popen(["sleep", "600"])
    subprocess.Popen(["sh", "-c", "trap '' HUP INT TERM; sleep 600 & wait"])
    subprocess.run(["sh", "-c", "setsid sh -c 'sleep 600 & sleep 600' >&- 2>&- &"])
    open(os.environ["TMPDIR"] + "/temporary", "x").close()
    print("begun", flush=True)
    time.sleep(600)
"""
MEMBERS = 9  # leader, guard, worker, two children, the deaf one's child, and the three that left


def start(folder, body=FAMILY, ends="supervise(command, 'study')", beside="", **options):
    """Start a program that hands `command` of the body over to the supervisor.

    Beside it, in its group but not below it, there may be another command.
    """
    script = folder / "program.py"
    script.write_text(f"{body}\nfrom study.core.supervisor import supervise\nsys.exit({ends})\n")
    temporary = folder / "temporary"
    temporary.mkdir(exist_ok=True)
    variables = {"PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)}
    command = [sys.executable, str(script)]
    if beside:
        command = ["sh", "-c", f'({beside} >&- 2>&- &); exec "$@"', "sh", *command]
    return Started(command, folder / "messages", **variables, **options)


def begin_family(folder, **options):
    family = start(folder, **options)
    family.read_until("begun")
    while len(family.marked()) < MEMBERS + ("beside" in options):
        time.sleep(0.01)
    return family


def interrupted(number, kept=KEPT["study"], name="study"):
    return f"{name}: interrupted by {signal.Signals(number).name}; {kept}"


@pytest.mark.parametrize("group", [False, True])
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_every_descendant_and_is_one_line(tmp_path, number, group):
    """When the command has ended there is nothing left to wait for; the pipe is still open."""
    with begin_family(tmp_path) as family:
        assert {*family.below()} < {*family.marked()}  # some have left by themselves
        family.send(number, group)
        assert family.wait() == 128 + number
        assert family.left() == []
        assert family.lines() == [interrupted(number)]
        assert list((tmp_path / "temporary").iterdir()) == []


def test_a_stranger_of_the_same_group_is_left_alone(tmp_path):
    with begin_family(tmp_path, beside="sleep 601") as family:
        (stranger,) = [one for one in family.marked() if command_line(one) == "sleep 601 "]
        assert os.getpgid(stranger) == family.pid
        assert stranger not in family.below()
        family.send(signal.SIGTERM)
        assert family.wait() == 128 + signal.SIGTERM
        assert family.left() == [stranger]


@pytest.mark.parametrize("generation", ["leader", "guard", "worker"])
def test_killing_one_of_the_three_processes_ends_the_others(tmp_path, generation):
    with begin_family(tmp_path) as family:
        victim = [family.pid, *family.below()][["leader", "guard", "worker"].index(generation)]
        assert "program.py" in command_line(victim)
        os.kill(victim, signal.SIGKILL)
        status = family.wait()
        assert family.left_in_the_end() == []
        if generation == "leader":
            assert (status, family.lines()) == (-signal.SIGKILL, [])
        else:
            assert status == 128 + signal.SIGKILL
            assert family.lines() == [f"study: ended by SIGKILL (out of memory?); {KEPT['study']}"]
        while list((tmp_path / "temporary").iterdir()):  # removed when all have ended
            time.sleep(0.01)


@pytest.mark.parametrize(
    ("body", "status", "messages"),
    [
        ("return 0", 0, []),
        ("return 7", 7, []),
        ("sys.exit(3)", 3, []),
        ("sys.exit('no more')", 1, ["no more"]),
        ("return 141", 141, []),
        ("os._exit(5)", 5, []),
        ("subprocess.Popen(['sleep', '600']); return 0", 0, []),
        ("os.kill(os.getpid(), 11)", 139, [f"study: ended by SIGSEGV; {KEPT['study']}"]),
    ],
)
@pytest.mark.parametrize("children", [signal.SIG_DFL, signal.SIG_IGN])
def test_the_commands_own_status_and_words_pass_through(tmp_path, body, status, messages, children):
    """Also where the caller ignores what becomes of children, and with one that was forgotten."""
    code = f"import os, resource, signal, subprocess, sys\nsignal.signal(17, {int(children)})\n"
    code += "resource.setrlimit(resource.RLIMIT_CORE, (0, 0))\n"
    with start(tmp_path, f"{code}def command():\n    {body}\n") as command:
        assert command.wait() == status
        assert command.left() == []
        assert command.lines() == messages


def test_an_ignored_signal_stays_ignored(tmp_path):
    """As with nohup."""
    with begin_family(tmp_path, ignored=[signal.SIGHUP]) as family:
        family.send(signal.SIGHUP, group=True)
        family.send(signal.SIGTERM)
        assert family.wait() == 128 + signal.SIGTERM
        assert family.lines() == [interrupted(signal.SIGTERM)]
        assert family.left() == []


def test_a_supervised_command_within_another_has_one_supervisor(tmp_path):
    nested = """
import subprocess, sys
def command():
    return subprocess.run([sys.executable, "family.py"], cwd=sys.path[0]).returncode
"""
    text = f"{FAMILY}\nfrom study.core.supervisor import supervise\n"
    (tmp_path / "family.py").write_text(f"{text}sys.exit(supervise(command, 'study'))\n")
    with start(tmp_path, nested, "supervise(command, 'figures')") as outer:
        outer.read_until("begun")
        outer.send(signal.SIGINT, group=True)
        assert outer.wait() == 128 + signal.SIGINT
        assert outer.lines() == [interrupted(signal.SIGINT, KEPT["figures"], "figures")]
        assert outer.left() == []


def test_a_supervisor_that_is_none_of_its_ancestors_does_not_count(tmp_path):
    with begin_family(tmp_path, PW_ELEMENTS_SUPERVISOR="999999999") as family:
        family.send(signal.SIGTERM)
        assert family.wait() == 128 + signal.SIGTERM
        assert family.left() == []


def test_a_module_runs_under_it_as_by_itself(tmp_path):
    """With its arguments; without a module, what to name is said."""
    (tmp_path / "shown.py").write_text("import sys\nprint(__name__, sys.argv)\nsys.exit(4)\n")
    command = [sys.executable, "-m", "study.core.supervisor"]
    environment = os.environ | {"PYTHONPATH": f"{ROOT}:{tmp_path}"}
    done = subprocess.run(
        [*command, "shown", "a b"], env=environment, capture_output=True, text=True
    )
    assert done.stdout == f"__main__ {[str(tmp_path / 'shown.py'), 'a b']}\n"
    assert (done.returncode, done.stderr) == (4, "")
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert "name a module" in done.stderr
    assert done.returncode == 1


@pytest.mark.parametrize(
    "command",
    [
        ["-m", "study", "--help"],
        ["-m", "study.site", "--help"],
        ["-m", "figures", "--help"],
        ["figures/fig05.py", "--help"],
        ["-m", "study.core.supervisor", "platform"],
    ],
    ids=["study", "site", "figures", "one figure", "supervisor"],
)
def test_libraries_that_crash_as_the_leader_ends_change_no_status(tmp_path, command):
    """As UCX does where Python loads MPI at start-up."""
    crash = "import atexit, os\nleader = os.getpid()\n"
    crash += "atexit.register(lambda: os.getpid() != leader or os.abort())\n"
    (tmp_path / "sitecustomize.py").write_text(crash)
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run(
        [sys.executable, *command], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout


@pytest.mark.parametrize("number", SIGNALS)
def test_a_figure_ends_with_the_study_that_it_has_started(tmp_path, number):
    command = [RUN, "figure", "fig05", "--results", tmp_path / "results", "--out", tmp_path / "out"]
    with Started(command, tmp_path / "messages") as figure:
        while not any("-m study 7.1" in command_line(one) for one in figure.below()):
            assert figure.process.poll() is None, figure.lines()
            time.sleep(0.002)
        figure.send(number)
        assert figure.wait() == 128 + number
        assert figure.left() == []
        assert figure.lines()[-1] == interrupted(number, KEPT["figures"], "figures")
        assert len([line for line in figure.lines() if "interrupted" in line]) == 1
    assert all(
        key.startswith(("pw", "galerkin")) for key in Results(tmp_path / "results").cases("7.1")
    )


def test_a_signal_before_the_command_began_is_one_line_and_leaves_nothing(tmp_path):
    """While ./run looks for DOLFINx: here in a Python that takes its time."""
    python = tmp_path / "python3"
    python.write_text("#!/bin/sh\nsleep 600\n")
    python.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    for group in (False, True):
        with Started([RUN, "true"], tmp_path / "messages", PATH=path) as run:
            while not any("sleep 600" in command_line(one) for one in run.below()):
                time.sleep(0.005)
            run.send(signal.SIGTERM, group)
            assert run.wait() == -signal.SIGTERM
            assert run.left_in_the_end() == []
            assert len(run.lines()) == 1, run.lines()
            (line,) = run.lines()
            assert line.startswith("run: interrupted by SIGTERM before the command began")
