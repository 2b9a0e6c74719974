"""The supervisor of all commands: no descendant survives a signal, and one line reports it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from study.run.store import Results
from study.run.supervisor import RESUME_HINTS
from tests.run.processes import TERMINATION_SIGNALS, SpawnedCommand, read_command_line

ROOT = Path(__file__).parents[2]
RUN_SCRIPT = ROOT / "run"

# Starts a child, a child that ignores all signals that can be ignored and has its own child, and
# children that have left their parent and their session; then works without handling signals
PROCESS_FAMILY_SOURCE = """
import os, subprocess, sys, time
def command():
    subprocess.Popen(["sleep", "600"])
    subprocess.Popen(["sh", "-c", "trap '' HUP INT TERM; sleep 600 & wait"])
    subprocess.run(["sh", "-c", "setsid sh -c 'sleep 600 & sleep 600' >&- 2>&- &"])
    open(os.environ["TMPDIR"] + "/temporary", "x").close()
    print("begun", flush=True)
    time.sleep(600)
"""
# leader, guard, worker, two children, one grandchild, and three processes in another session
N_FAMILY_PROCESSES = 9


def start_supervised_program(
    folder,
    body=PROCESS_FAMILY_SOURCE,
    exit_expression="run_in_supervised_process(command, 'study')",
    sibling_command="",
    **options,
):
    """Start a program that runs the function `command` of the body under the supervisor.

    Args:
        folder: folder for the program, its messages and its temporary files.
        body: Python source that defines `command`.
        exit_expression: Python expression of the exit status.
        sibling_command: another command in the same process group that is not a descendant.
        options: arguments of `SpawnedCommand`.
    """
    script = folder / "program.py"
    script.write_text(
        f"{body}\nfrom study.run.supervisor import run_in_supervised_process\n"
        f"sys.exit({exit_expression})\n"
    )
    temporary = folder / "temporary"
    temporary.mkdir(exist_ok=True)
    variables = {"PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)}
    command = [sys.executable, str(script)]
    if sibling_command:
        command = ["sh", "-c", f'({sibling_command} >&- 2>&- &); exec "$@"', "sh", *command]
    return SpawnedCommand(command, folder / "messages", **variables, **options)


def start_process_family(folder, **options):
    """Start `PROCESS_FAMILY_SOURCE`, and wait until all its processes run."""
    family = start_supervised_program(folder, **options)
    family.read_output_until("begun")
    while len(family.list_marked_processes()) < N_FAMILY_PROCESSES + ("sibling_command" in options):
        time.sleep(0.01)
    return family


def interruption_message(signal_number, kept_message=RESUME_HINTS["study"], name="study"):
    """Return the message of a command that was ended by a signal."""
    return f"{name}: interrupted by {signal.Signals(signal_number).name}; {kept_message}"


@pytest.mark.parametrize("group", [False, True])
@pytest.mark.parametrize("number", TERMINATION_SIGNALS)
def test_a_signal_ends_every_descendant_and_gives_one_line(tmp_path, number, group):
    """A signal to a command ends all its descendants and gives a message of one line.

    No process remains when the command has ended, although the pipe of its output is still open.
    """
    with start_process_family(tmp_path) as family:
        # some processes have left their parent
        assert {*family.list_descendants()} < {*family.list_marked_processes()}
        family.send_signal(number, group)
        assert family.wait() == 128 + number
        assert family.list_survivors() == []
        assert family.read_messages() == [interruption_message(number)]
        assert list((tmp_path / "temporary").iterdir()) == []


def test_a_foreign_process_of_the_same_group_is_not_ended(tmp_path):
    with start_process_family(tmp_path, sibling_command="sleep 601") as family:
        (stranger,) = [
            process
            for process in family.list_marked_processes()
            if read_command_line(process) == "sleep 601 "
        ]
        assert os.getpgid(stranger) == family.pid
        assert stranger not in family.list_descendants()
        family.send_signal(signal.SIGTERM)
        assert family.wait() == 128 + signal.SIGTERM
        assert family.list_survivors() == [stranger]


@pytest.mark.parametrize("generation", ["leader", "guard", "worker"])
def test_killing_one_of_the_three_processes_ends_the_others(tmp_path, generation):
    with start_process_family(tmp_path) as family:
        victim = [family.pid, *family.list_descendants()][
            ["leader", "guard", "worker"].index(generation)
        ]
        assert "program.py" in read_command_line(victim)
        os.kill(victim, signal.SIGKILL)
        status = family.wait()
        assert family.list_survivors_after_waiting() == []
        if generation == "leader":
            assert (status, family.read_messages()) == (-signal.SIGKILL, [])
        else:
            assert status == 128 + signal.SIGKILL
            assert family.read_messages() == [
                f"study: ended by SIGKILL (out of memory?); {RESUME_HINTS['study']}"
            ]
        while list((tmp_path / "temporary").iterdir()):  # removed after the last process has ended
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
        ("os.kill(os.getpid(), 11)", 139, [f"study: ended by SIGSEGV; {RESUME_HINTS['study']}"]),
    ],
)
@pytest.mark.parametrize("children", [signal.SIG_DFL, signal.SIG_IGN])
def test_status_and_messages_of_the_command_are_passed_on(
    tmp_path, body, status, messages, children
):
    """The supervisor passes on the status and the messages of a command.

    This holds even if the caller ignores SIGCHLD, or if the command leaves a child behind.
    """
    code = f"import os, resource, signal, subprocess, sys\nsignal.signal(17, {int(children)})\n"
    code += "resource.setrlimit(resource.RLIMIT_CORE, (0, 0))\n"
    with start_supervised_program(tmp_path, f"{code}def command():\n    {body}\n") as command:
        assert command.wait() == status
        assert command.list_survivors() == []
        assert command.read_messages() == messages


def test_an_ignored_signal_remains_ignored(tmp_path):
    """A signal that was ignored before remains ignored, as under nohup."""
    with start_process_family(tmp_path, ignored=[signal.SIGHUP]) as family:
        family.send_signal(signal.SIGHUP, to_group=True)
        family.send_signal(signal.SIGTERM)
        assert family.wait() == 128 + signal.SIGTERM
        assert family.read_messages() == [interruption_message(signal.SIGTERM)]
        assert family.list_survivors() == []


def test_a_supervised_command_within_another_has_one_supervisor(tmp_path):
    nested = """
import subprocess, sys
def command():
    return subprocess.run([sys.executable, "family.py"], cwd=sys.path[0]).returncode
"""
    text = f"{PROCESS_FAMILY_SOURCE}\nfrom study.run.supervisor import run_in_supervised_process\n"
    (tmp_path / "family.py").write_text(
        f"{text}sys.exit(run_in_supervised_process(command, 'study'))\n"
    )
    with start_supervised_program(
        tmp_path, nested, "run_in_supervised_process(command, 'figures')"
    ) as outer:
        outer.read_output_until("begun")
        outer.send_signal(signal.SIGINT, to_group=True)
        assert outer.wait() == 128 + signal.SIGINT
        assert outer.read_messages() == [
            interruption_message(signal.SIGINT, RESUME_HINTS["figures"], "figures")
        ]
        assert outer.list_survivors() == []


def test_a_supervisor_that_is_not_an_ancestor_is_disregarded(tmp_path):
    with start_process_family(tmp_path, PW_ELEMENTS_SUPERVISOR="999999999") as family:
        family.send_signal(signal.SIGTERM)
        assert family.wait() == 128 + signal.SIGTERM
        assert family.list_survivors() == []


def test_a_module_runs_under_the_supervisor_as_without_it(tmp_path):
    """A module runs under the supervisor in the same way as without it.

    It receives its arguments. If no module is given, a message asks for one.
    """
    (tmp_path / "shown.py").write_text("import sys\nprint(__name__, sys.argv)\nsys.exit(4)\n")
    command = [sys.executable, "-m", "study.run.supervisor"]
    environment = os.environ | {"PYTHONPATH": f"{ROOT}:{tmp_path}"}
    process = subprocess.run(
        [*command, "shown", "a b"], env=environment, capture_output=True, text=True
    )
    assert process.stdout == f"__main__ {[str(tmp_path / 'shown.py'), 'a b']}\n"
    assert (process.returncode, process.stderr) == (4, "")
    process = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert "name a module" in process.stderr
    assert process.returncode == 1


@pytest.mark.parametrize(
    "command",
    [
        ["-m", "study", "--help"],
        ["-m", "study.publish.site", "--help"],
        ["-m", "figures", "--help"],
        ["figures/fig05.py", "--help"],
        ["-m", "study.run.supervisor", "platform"],
    ],
    ids=["study", "site", "figures", "one figure", "supervisor"],
)
def test_libraries_that_crash_at_the_end_of_the_leader_do_not_change_the_status(tmp_path, command):
    """Libraries that crash when the leader ends do not change the status of the command.

    UCX crashes in this way if Python loads MPI at start-up.
    """
    crash = "import atexit, os\nleader = os.getpid()\n"
    crash += "atexit.register(lambda: os.getpid() != leader or os.abort())\n"
    (tmp_path / "sitecustomize.py").write_text(crash)
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"}
    process = subprocess.run(
        [sys.executable, *command], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert (process.returncode, process.stderr) == (0, "")
    assert process.stdout


@pytest.mark.parametrize("number", TERMINATION_SIGNALS)
def test_a_signal_to_a_figure_also_ends_the_study_that_it_started(tmp_path, number):
    command = [
        RUN_SCRIPT,
        "figure",
        "fig05",
        "--results",
        tmp_path / "results",
        "--out",
        tmp_path / "out",
    ]
    with SpawnedCommand(command, tmp_path / "messages") as figure:
        while not any(
            "-m study 7.1" in read_command_line(process) for process in figure.list_descendants()
        ):
            assert figure.process.poll() is None, figure.read_messages()
            time.sleep(0.002)
        figure.send_signal(number)
        assert figure.wait() == 128 + number
        assert figure.list_survivors() == []
        assert figure.read_messages()[-1] == interruption_message(
            number, RESUME_HINTS["figures"], "figures"
        )
        assert len([line for line in figure.read_messages() if "interrupted" in line]) == 1
    assert all(
        key.startswith(("pw", "galerkin")) for key in Results(tmp_path / "results").cases("7.1")
    )


def test_a_signal_before_the_command_starts_gives_one_line_and_leaves_no_process(tmp_path):
    """A signal before the command starts gives a message of one line and leaves no process.

    The signal arrives while ./run searches for DOLFINx, which takes long with the slow Python of
    this test.
    """
    python = tmp_path / "python3"
    python.write_text("#!/bin/sh\nsleep 600\n")
    python.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    for group in (False, True):
        with SpawnedCommand([RUN_SCRIPT, "true"], tmp_path / "messages", PATH=path) as process:
            while not any(
                "sleep 600" in read_command_line(descendant)
                for descendant in process.list_descendants()
            ):
                time.sleep(0.005)
            process.send_signal(signal.SIGTERM, group)
            assert process.wait() == -signal.SIGTERM
            assert process.list_survivors_after_waiting() == []
            assert len(process.read_messages()) == 1, process.read_messages()
            (line,) = process.read_messages()
            assert line.startswith("run: interrupted by SIGTERM before the command began")
