"""The gate: what it refuses to start, and that its steps are those that it lists."""

import importlib.util
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GATE = ROOT / ".ci" / "run"


def listed_steps():
    return re.search(r"^all='(.*)'$", GATE.read_text(), re.MULTILINE)[1].split()


@pytest.fixture
def clone(tmp_path):
    """A folder with the gate alone."""
    (tmp_path / ".ci").mkdir()
    for file in (GATE, GATE.with_name("signals.sh")):
        shutil.copy(file, tmp_path / ".ci")
    return tmp_path


def start(clone, *arguments):
    command = ["bash", str(clone / ".ci" / "run"), *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def test_every_step_is_described_and_has_its_function():
    text = GATE.read_text()
    assert len(listed_steps()) == 8
    for step in listed_steps():
        assert re.search(rf"^#   {re.escape(step)}  ", text, re.MULTILINE), step
        assert re.search(rf"^run_{re.sub(r'[-.]', '_', step)}\(\)", text, re.MULTILINE), step


def test_steps_are_logged_by_their_names(clone):
    """Whatever variables they set."""
    (clone / "results").mkdir()
    (clone / "results" / "report.html").write_text("")
    (clone / "run").write_text(
        '#!/bin/sh\n[ $# -gt 1 ] || { echo "fig01 x" && exit; }\n'
        'for folder; do :; done\necho x >"$folder/fig01.png" && echo x >"$folder/fig01.pdf"\n'
    )
    (clone / "run").chmod(0o755)
    done = start(clone, "figures")
    assert done.returncode == 0, done.stderr
    assert re.search(r"^   figures +\d+ s$", done.stdout, re.MULTILINE)


def test_unknown_steps_are_refused(clone):
    done = start(clone, "studdy")
    assert done.returncode == 1
    assert "there is no step studdy, but: study site" in done.stderr


def test_the_whole_gate_starts_from_no_results(clone):
    (clone / "results").mkdir()
    (clone / "results" / "old.json").write_text("{}")
    done = start(clone)
    assert done.returncode == 1
    assert "the folder results is not empty" in done.stderr


@pytest.mark.parametrize("step", ["site", "figures", "docs", "pages"])
def test_steps_that_take_results_ask_for_them(clone, step):
    done = start(clone, step)
    assert done.returncode == 1
    assert "there are no results: run ./run study" in done.stderr


def test_leaving_out_the_other_version_is_repeated_in_the_last_line(clone):
    done = start(clone, "--without-0.11", "dolfinx-0.11")
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1] == (
        "== all passed, WITHOUT DOLFINx 0.11, as --without-0.11 asked for"
    )


def test_each_command_of_the_documents_is_run_or_left_out_for_a_reason():
    path = ROOT / ".ci" / "documented.py"
    spec = importlib.util.spec_from_file_location("documented", path)
    documented = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(documented)
    commands = [c for page in documented.PAGES for c in documented.shown_commands(page)]
    assert len(commands) > 20
    for command in commands:
        left_out = any(re.match(like, command) for like in documented.LEFT_OUT)
        assert left_out or re.match(r"(\./|~/pw-elements/)run ", command), command
