"""The script .ci/run, which runs all checks: its listed steps, and when it refuses to start."""

import importlib.util
import re
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CI_SCRIPT = ROOT / ".ci" / "run"


def read_ci_step_names():
    """Return the names of the steps that the script lists."""
    return re.search(r"^all='(.*)'$", CI_SCRIPT.read_text(), re.MULTILINE)[1].split()


@pytest.fixture
def folder_with_ci_script(tmp_path):
    """Create a folder that contains only the script .ci/run."""
    (tmp_path / ".ci").mkdir()
    for file in (CI_SCRIPT, CI_SCRIPT.with_name("signals.sh")):
        shutil.copy(file, tmp_path / ".ci")
    return tmp_path


def run_ci_script(folder, *arguments):
    """Run the script in its folder, and return the completed process."""
    command = ["bash", str(folder / ".ci" / "run"), *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def test_every_ci_step_is_described_and_has_a_function():
    text = CI_SCRIPT.read_text()
    assert len(read_ci_step_names()) == 9
    for step in read_ci_step_names():
        assert re.search(rf"^#   {re.escape(step)}  ", text, re.MULTILINE), step
        assert re.search(rf"^run_{re.sub(r'[-.]', '_', step)}\(\)", text, re.MULTILINE), step


def test_every_shell_script_is_linted():
    scripts = {
        str(path.relative_to(ROOT))
        for path in CI_SCRIPT.parent.iterdir()
        if path.suffix == ".sh" or path.read_bytes().startswith(b"#!/usr/bin/env bash")
    }
    (line,) = re.findall(r"^  step shellcheck (.*)$", CI_SCRIPT.read_text(), re.MULTILINE)
    assert set(line.split()) == scripts | {"run"}


def test_ci_steps_are_logged_under_their_names(folder_with_ci_script):
    """Steps are logged under their names, whatever variables a step sets."""
    (folder_with_ci_script / "results").mkdir()
    (folder_with_ci_script / "results" / "report.html").write_text("")
    (folder_with_ci_script / "run").write_text(
        '#!/bin/sh\n[ $# -gt 1 ] || { echo "fig01 x" && exit; }\n'
        'for folder; do :; done\necho x >"$folder/fig01.png" && echo x >"$folder/fig01.pdf"\n'
    )
    (folder_with_ci_script / "run").chmod(0o755)
    process = run_ci_script(folder_with_ci_script, "figures")
    assert process.returncode == 0, process.stderr
    assert re.search(r"^   figures +\d+ s$", process.stdout, re.MULTILINE)


def test_unknown_ci_steps_are_refused(folder_with_ci_script):
    process = run_ci_script(folder_with_ci_script, "studdy")
    assert process.returncode == 1
    assert "there is no step studdy; the steps are: study site" in process.stderr


def test_a_complete_ci_run_refuses_existing_results(folder_with_ci_script):
    (folder_with_ci_script / "results").mkdir()
    (folder_with_ci_script / "results" / "old.json").write_text("{}")
    process = run_ci_script(folder_with_ci_script)
    assert process.returncode == 1
    assert "the folder results is not empty" in process.stderr


@pytest.mark.parametrize("step", ["site", "figures", "docs", "pages"])
def test_ci_steps_that_need_results_refuse_to_start_without_them(folder_with_ci_script, step):
    process = run_ci_script(folder_with_ci_script, step)
    assert process.returncode == 1
    assert "there are no results: run ./run study" in process.stderr


def test_the_last_line_of_ci_repeats_that_a_version_is_left_out(folder_with_ci_script):
    process = run_ci_script(folder_with_ci_script, "--without-0.11", "dolfinx-0.11")
    assert process.returncode == 0
    assert process.stdout.splitlines()[-1] == (
        "== all passed, WITHOUT DOLFINx 0.11, as requested by --without-0.11"
    )


@pytest.mark.parametrize(
    ("script_status", "outcome"),
    [(0, "passed"), (1, "failed"), (77, "passed without pip install")],
)
def test_the_step_pip_passes_fails_or_is_named_as_skipped(
    folder_with_ci_script, script_status, outcome
):
    script = folder_with_ci_script / ".ci" / "pip"
    script.write_text(f"#!/bin/sh\nexit {script_status}\n")
    script.chmod(0o755)
    process = run_ci_script(folder_with_ci_script, "pip")
    message = "the Python of ./run is older than 3.12: pip install with DOLFINx is not tested"
    assert process.returncode == (outcome == "failed")
    assert process.stdout.endswith("\n== all passed\n") == (outcome != "failed")
    assert (f"\n== skipped:\n   {message}\n" in process.stdout) == ("without" in outcome)


def test_a_signal_ends_a_script_with_its_command_and_deletes_its_folder(tmp_path):
    script = tmp_path / "script"
    script.write_text(
        f"set -eu; . {CI_SCRIPT.with_name('signals.sh')}\n"
        f"temporary={tmp_path}/temporary; mkdir $temporary\n"
        "wait_for sh -c 'echo started; exec sleep 1000'\n"
    )
    with subprocess.Popen(["bash", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "started\n"
        process.terminate()
        process.communicate(timeout=60)  # until the command has closed its output
    assert process.returncode == -signal.SIGTERM
    assert list(tmp_path.iterdir()) == [script]


def test_each_command_of_the_documents_is_run_or_left_out_with_a_reason():
    path = ROOT / ".ci" / "documented.py"
    spec = importlib.util.spec_from_file_location("documented", path)
    documented = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(documented)
    commands = [c for page in documented.PAGES for c in documented.shown_commands(page)]
    assert len(commands) > 20
    for command in commands:
        left_out = any(re.match(like, command) for like in documented.LEFT_OUT)
        run_patterns = (documented.IN_PROJECT, documented.IN_OWN_FOLDER)
        assert left_out or any(re.match(like, command) for like in run_patterns), command
