"""The command line of the study: computed, kept and reported results, and exit statuses."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import study.publish.report
from figures.__main__ import draw_outdated_figures
from study.publish.command import main
from study.run import runner
from study.run.cases import load_section
from study.run.store import Result, Results, StudyError, save
from study.run.supervisor import RESUME_HINTS
from tests.run.processes import SpawnedCommand
from tests.study.toystudy import (
    EMPTY_FIGURE_DRAWING,
    count_started_runs,
    install_toy_study,
    make_claim_toml,
)

ROOT = Path(__file__).parents[2]

ORIGINAL_BUILD_REPORT = study.publish.report.build_report

# Debian combines WeasyPrint with a newer pydyf, in which some methods have other names
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:pydyf")


@pytest.fixture
def toy_study(tmp_path, monkeypatch):
    """Install a toy study without a report in a temporary folder, and return this folder."""
    install_toy_study(tmp_path, monkeypatch)
    monkeypatch.setattr(study.publish.report, "build_report", lambda *_: [])
    return tmp_path


@pytest.fixture
def real_report(toy_study, monkeypatch):
    """Enable the report, which is slow and which most tests of this module do not need."""
    assert toy_study
    monkeypatch.setattr(study.publish.report, "build_report", ORIGINAL_BUILD_REPORT)
    # the texts of the report describe the sections of the real study
    monkeypatch.setattr(study.publish.report._ReportRenderer, "_render_body", lambda *_: "text")


@pytest.fixture
def results_folder(toy_study):
    """Return the path for the results of the toy study."""
    return toy_study / "results"


@pytest.fixture
def run_study(results_folder):
    """Return a function that runs the study's command line and returns its exit status."""

    def run_and_return_status(*arguments, jobs=1):
        arguments = [*arguments, "--jobs", str(jobs), "--out", str(results_folder)]
        return main(arguments, figures=EMPTY_FIGURE_DRAWING)

    return run_and_return_status


def replace_in_file(path, old, new):
    """Replace all occurrences of `old` in a file; there has to be at least one."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.usefixtures("real_report")
def test_the_whole_study_writes_all_results_and_the_report(run_study, results_folder, capsys):
    assert run_study() == 0
    printed = capsys.readouterr()
    files = [path for path in results_folder.rglob("*") if path.is_file()]
    assert {str(path.relative_to(results_folder)) for path in files} == {
        "1/a.json", "1/a.npz", "1/b.json", "1/b.npz", "2/only.json",
        "claims.json", "figures/index.json", "report.html", "report.pdf", ".pw-elements",
    }  # fmt: skip
    summary, first_section, second_section = printed.err.splitlines()
    assert summary == "0 of 3 results are reused; 3 to be computed"
    assert re.fullmatch(r"1    First toy: 2 computed in \d\.\d s", first_section)
    assert re.fullmatch(r"2    Second toy: 1 computed in \d\.\d s", second_section)
    assert "1 statements of the paper: 1 reproduced; 0 other than pinned" in printed.out
    assert str(results_folder / "report.html") in printed.out


def test_changed_and_corrupt_cases_are_computed_again(run_study, toy_study, results_folder, capsys):
    assert run_study("1") == 0
    assert count_started_runs(toy_study) == 2
    capsys.readouterr()
    assert run_study("1") == 0
    assert capsys.readouterr().err == "2 of 2 results are reused\n"
    assert count_started_runs(toy_study) == 2
    assert run_study("1", "--force") == 0
    assert count_started_runs(toy_study) == 4
    replace_in_file(toy_study / "toy" / "common.py", "2.0", 'float("2.0")')
    assert run_study("1") == 0
    assert (count_started_runs(toy_study), Results(results_folder).scalar("1/b", "y")) == (6, 5.0)
    (results_folder / "1" / "a.json").write_text("{")
    assert run_study("1") == 0
    assert "1/a: its stored result cannot be read" in capsys.readouterr().err
    assert (count_started_runs(toy_study), Results(results_folder).scalar("1/a", "y")) == (7, 2.0)
    assert run_study("2", "--force") == 0  # a subset uses the stored results of other cases
    assert count_started_runs(toy_study) == 7
    assert Results(results_folder).claims()[0]["verdict"] == "holds"


def test_recorded_results_are_counted_separately_and_computed_on_demand(
    run_study, toy_study, results_folder, capsys
):
    """Recorded results are counted separately, and they are computed only on demand.

    The second case of the section is read from a record, like the costly cases of the study.
    """
    cases_with_record = (
        'CASES = [case("a"), replace(case("b", 9.0), record="toy/record.json", '
        'computing_case=case("b", 2.5))]'
    )
    replace_in_file(
        toy_study / "toy" / "one.py", 'CASES = [case("a"), case("b", 2.5)]', cases_with_record
    )
    replace_in_file(
        toy_study / "toy" / "one.py", "import os", "import os\nfrom dataclasses import replace"
    )

    def read_messages_without_durations():
        return [re.sub(r"\d\.\d s", "# s", line) for line in capsys.readouterr().err.splitlines()]

    assert run_study("1") == 1  # 18 is not 5
    assert read_messages_without_durations() == [
        "0 of 2 results are reused; 1 to be computed; 1 to be read from tracked records",
        "1    First toy: 1 computed in # s, 1 read from tracked records",
    ]
    assert Results(results_folder)["1/b"].record == "toy/record.json"
    assert not Results(results_folder)["1/a"].record
    with pytest.raises(StudyError, match=r"1/b has no curves: it is read from toy/record\.json"):
        Results(results_folder).curves("1/b")
    assert len(Results(results_folder).curves("1/a")["x"]) == 3
    assert run_study("1", "--all") == 0
    assert read_messages_without_durations() == [
        "1 of 2 results are reused; 1 to be computed",
        "1    First toy: 1 computed in # s",
    ]
    assert Results(results_folder).scalar("1/b", "y") == 5.0
    assert not Results(results_folder)["1/b"].record
    assert run_study("1") == 0  # computed results are kept
    assert read_messages_without_durations() == ["2 of 2 results are reused"]


def test_verdicts_of_other_sections_are_not_reported(run_study, toy_study, capsys):
    other_claim = make_claim_toml(id='"other"', args='{ key = "2/only", name = "z" }', value="8.0")
    (toy_study / "claims.toml").write_text(make_claim_toml() + other_claim)
    assert run_study("1") == 0
    assert capsys.readouterr().out.startswith("1 statements of the paper: 1 reproduced; 0 other")
    assert run_study("2") == 1
    assert capsys.readouterr().out.splitlines()[0].startswith("other  7  = 8 ± 1e-12")
    assert run_study("1") == 0
    assert "other" not in capsys.readouterr().out.splitlines()[0].split(";")[0]
    assert run_study() == 1


def test_results_of_deleted_cases_are_removed(run_study, results_folder):
    save(results_folder, "1", "former", Result({"y": 1.0}, {"y": "1"}), {"problem": "toy"}, {})
    assert run_study("2") == 0
    assert Results(results_folder).cases("1") == ["former"]
    assert run_study("1") == 0
    assert Results(results_folder).cases("1") == ["a", "b"]


@pytest.mark.usefixtures("real_report")
def test_an_incomplete_report_gives_status_1_only_after_the_whole_study(
    run_study, monkeypatch, capsys
):
    monkeypatch.setattr(
        "study.publish.report.build_report", lambda *_: ["section 1: no such result"]
    )
    assert run_study("1") == 0
    assert "incomplete" not in capsys.readouterr().err
    assert run_study() == 1
    assert "report: incomplete, section 1: no such result" in capsys.readouterr().err


def test_a_differing_verdict_gives_status_1_and_is_printed(run_study, toy_study, capsys):
    verdict_line = re.compile(r"^the-claim  5  = 4 .*fails, pinned: holds$", re.M)
    replace_in_file(toy_study / "claims.toml", "value = 5.0", "value = 4.0")
    for command in ("1", "check", "report"):
        assert run_study(command) == 1
        assert verdict_line.search(capsys.readouterr().out) or command == "report"
    contradicted_claim = make_claim_toml(
        value="4.0", grade='"contradicted"', found="5.0", found_tol="0.1"
    )
    (toy_study / "claims.toml").write_text(contradicted_claim)
    assert run_study("check") == run_study("report") == 0
    replace_in_file(toy_study / "claims.toml", "found = 5.0", "found = 5.5")
    assert run_study("check") == 1


def test_a_missing_verdict_fails_the_whole_study_and_the_check_but_no_subset(
    run_study, toy_study, capsys
):
    replace_in_file(toy_study / "claims.toml", "1/b", "1/never")
    assert run_study("1") == 0
    assert "1 not judged" in capsys.readouterr().out
    assert [run_study(*command) for command in (["report"], [], ["check"])] == [0, 1, 1]
    assert "not judged, pinned: holds" in capsys.readouterr().out


def test_a_case_that_raises_stores_no_result_and_does_not_affect_the_others(
    run_study, toy_study, results_folder, capsys
):
    run_study("1")
    old_result = (results_folder / "1" / "b.json").read_text()
    replace_in_file(toy_study / "toy" / "one.py", 'case("a")', 'case("a", do="raise")')
    forget_imported_sections(toy_study)
    assert run_study("1", "--force") == 1
    errors, results = capsys.readouterr().err, Results(results_folder)
    failure = r"1/a: failed: ArithmeticError: no convergence \(one\.py, line \d+\)$"
    assert re.search(failure, errors, re.M)
    assert "second line" not in errors
    assert "1/a" not in results
    assert results.scalar("1/b", "y") == 5.0
    assert (results_folder / "1" / "b.json").read_text() != old_result


@pytest.mark.parametrize("command", ["report", "check"])
@pytest.mark.parametrize("damage", ["{", "", "[" * 100_000, "another section's"])
def test_a_corrupt_result_affects_only_its_own_verdicts(
    run_study, toy_study, results_folder, capsys, command, damage
):
    """A corrupt result affects only the verdicts that are based on it.

    The exit status is 3, and a message names the command that computes the result again.
    """
    other_claim = make_claim_toml(id='"other"', args='{ key = "2/only", name = "z" }', value="7.0")
    wrong_claim = make_claim_toml(id='"wrong"', value="4.0")
    (toy_study / "claims.toml").write_text(make_claim_toml() + other_claim + wrong_claim)
    assert run_study() == 1
    capsys.readouterr()
    path = results_folder / "2" / "only.json"
    text = (results_folder / "1" / "b.json").read_text() if damage.startswith("another") else damage
    path.write_text(text)
    assert run_study(command) == 3
    printed = capsys.readouterr()
    assert "study: of 3 results 1 is corrupt: 2/only; run ./run study 2/only\n" in printed.err
    assert f"study: other is not judged: {path} cannot be used" in printed.err
    assert "3 reproduced; 1 not judged; 1 other than pinned" in printed.out
    assert "wrong  5  = 4" in printed.out
    verdicts = {row["id"]: row["verdict"] for row in Results(results_folder).claims()}
    if command == "report":
        assert verdicts == {"the-claim": "holds", "other": "not judged", "wrong": "fails"}
    assert run_study("2/only") == 0
    assert run_study(command) == 1  # the claim "wrong" fails
    assert "corrupt" not in capsys.readouterr().err


def test_a_missing_scalar_does_not_crash_the_check(run_study, toy_study, capsys):
    other_claim = make_claim_toml(id='"other"', args='{ key = "2/only", name = "no" }')
    (toy_study / "claims.toml").write_text(make_claim_toml() + other_claim)
    assert run_study() == 1
    printed = capsys.readouterr()
    assert "study: other is not judged: " in printed.err
    assert "has no scalar 'no' (but z): run ./run study 2/only --force" in printed.err
    assert "other" in printed.out


def test_foreign_files_in_a_section_are_kept_and_named(run_study, results_folder, capsys):
    run_study("1")
    for name in ("notes", "broken"):
        (results_folder / "1" / f"{name}.json").write_text('{"mine": 1}')
    (results_folder / "1" / "notes.npz").write_text("mine")
    capsys.readouterr()
    assert run_study("check") == 3
    messages = capsys.readouterr().err
    for name in ("notes", "broken"):
        path = results_folder / "1" / f"{name}.json"
        assert f"study: {path} is the result of no case, and cannot be read: move it" in messages
    assert run_study("1") == 3
    assert (
        f"{results_folder / '1' / 'broken.json'} is the result of no case"
        in capsys.readouterr().err
    )
    assert {path.stem for path in (results_folder / "1").iterdir()} == {"a", "b", "notes", "broken"}


def test_a_folder_in_place_of_a_file_gives_a_one_line_error(run_study, results_folder, capsys):
    assert run_study("1") == 0
    (results_folder / "claims.json").unlink()
    (results_folder / "claims.json" / "mine").mkdir(parents=True)
    capsys.readouterr()
    assert run_study("report") == 2
    assert capsys.readouterr().err.endswith("claims.json is no regular file: it is not replaced\n")
    assert (results_folder / "claims.json" / "mine").is_dir()


@pytest.mark.parametrize("command", ["1", "1/b", "report", ""])
def test_nothing_is_written_to_a_foreign_folder(run_study, results_folder, capsys, command):
    """No command writes to a results folder that the study has not created.

    This holds even if it contains a folder with the name of a section, and a result.
    """
    (results_folder / "1").mkdir(parents=True)
    for name in ("claims.json", "1/a.json", "1/former.json", "letter.txt"):
        (results_folder / name).write_text('{"mine": 1}')
    save(results_folder, "2", "only", Result({"y": 1.0}, {"y": "1"}), {"problem": "toy"}, {})
    contents = {path: path.read_bytes() for path in results_folder.rglob("*") if path.is_file()}
    assert run_study(*command.split()) == 2
    messages = capsys.readouterr().err
    assert (
        f"study: {results_folder} is not empty, and does not say that it is a folder of results"
        in messages
    )
    assert {
        path: path.read_bytes() for path in results_folder.rglob("*") if path.is_file()
    } == contents


def test_results_of_an_earlier_version_are_outdated_and_computed_again(
    run_study, toy_study, results_folder, capsys
):
    run_study("1")
    (results_folder / ".pw-elements").unlink()
    for case in "ab":
        path = results_folder / "1" / f"{case}.json"
        content = json.loads(path.read_text())
        keys = ("case", "parameters", "scalars", "units", "provenance")
        path.write_text(json.dumps({key: content[key] for key in keys}))
    capsys.readouterr()
    assert run_study("check") == 1
    assert "of 3 results 2 are outdated: 1/a, 1/b; run ./run study 1/a 1/b\n" in (
        capsys.readouterr().err
    )
    assert count_started_runs(toy_study) == 2
    assert run_study("1") == 0
    assert count_started_runs(toy_study) == 4


@pytest.mark.usefixtures("real_report")
def test_the_report_command_restores_deleted_files(run_study, results_folder):
    run_study()
    for name in ("claims.json", "report.html", "report.pdf", "figures/index.json"):
        (results_folder / name).unlink()
    assert run_study("report") == 0
    assert (results_folder / "report.pdf").read_bytes().startswith(b"%PDF")
    assert Results(results_folder).claims()[0]["verdict"] == "holds"


def test_list_prints_the_state_of_each_case(run_study, toy_study, results_folder, capsys):
    run_study("1")
    (results_folder / "1" / "a.json").write_text("{")
    capsys.readouterr()
    assert run_study("list") == 0
    expected = (
        "1  First toy|    corrupt   1/a|    stored    1/b|2  Second toy|    missing   2/only|"
    )
    assert capsys.readouterr().out.split("\n") == expected.split("|")
    replace_in_file(toy_study / "toy" / "common.py", "2.0", "3.0")
    run_study("list")
    assert "    outdated  1/b" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["check", "report"])
def test_check_and_report_name_outdated_and_missing_results(
    run_study, toy_study, results_folder, capsys, command
):
    run_study()
    capsys.readouterr()
    assert run_study(command) == 0
    assert "outdated" not in (messages := capsys.readouterr().err)
    assert "missing" not in messages
    replace_in_file(toy_study / "toy" / "one.py", "FACTOR * value", "value * FACTOR")
    (results_folder / "2" / "only.json").unlink()
    assert run_study(command) == 0
    assert capsys.readouterr().err.splitlines()[:2] == [
        "study: of 3 results 2 are outdated: 1/a, 1/b; run ./run study 1/a 1/b",
        "study: of 3 results 1 is missing: 2/only; run ./run study 2/only",
    ]
    replace_in_file(toy_study / "toy" / "one.py", "value * FACTOR", "FACTOR * value")
    replace_in_file(toy_study / "toy" / "one.py", "CASES =", "# what is computed\nCASES =")
    assert run_study(command) == 0
    assert "outdated" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["9.9"], "there is no section 9.9; there are 1, 2"),
        (["1", "9.9"], "there is no section 9.9; there are 1, 2"),
        (["1", "--jobs", "0"], "--jobs needs at least 1 process, not 0"),
        (
            ["1", "--out", "/dev/null/results"],
            "/dev/null/results cannot be written to: Not a directory",
        ),
        (["report", "--out", "/dev/null/results"], "there are no results in /dev/null/results"),
        (["check"], "there are no results in results"),
        (["list", "1"], "list stands alone, without sections"),
    ],
)
def test_bad_usage_gives_status_2_and_one_line_before_any_computation(
    toy_study, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(toy_study)
    assert main(arguments) == 2
    errors = capsys.readouterr().err
    assert errors.startswith(f"study: {message}")
    assert errors.count("\n") == 1
    assert count_started_runs(toy_study) == 0


def test_an_error_in_the_claims_is_found_before_any_computation(run_study, toy_study, capsys):
    (toy_study / "claims.toml").write_text(make_claim_toml(relation='"~"'))
    assert run_study("1") == 2
    assert "claim the-claim: relation" in capsys.readouterr().err
    assert count_started_runs(toy_study) == 0


@pytest.mark.usefixtures("real_report")
def test_failing_figures_give_status_1_but_do_not_prevent_the_report(results_folder):
    def fail_to_draw(folder, complete, jobs):
        return not EMPTY_FIGURE_DRAWING.draw_outdated_figures(folder, complete, jobs)

    arguments = ["1", "--jobs", "1", "--out", str(results_folder)]
    assert main(arguments, EMPTY_FIGURE_DRAWING._replace(draw_outdated_figures=fail_to_draw)) == 1
    assert (results_folder / "report.html").exists()
    assert main(arguments, EMPTY_FIGURE_DRAWING) == 0


def test_without_functions_that_draw_the_study_says_that_no_figures_are_drawn(
    results_folder, capsys
):
    assert results_folder.parent.exists()
    assert main(["1", "--jobs", "1", "--out", str(results_folder)]) == 0
    assert "study: figures are not drawn; ./run study draws them" in capsys.readouterr().err


def test_parallel_tasks_that_fail_are_reported(toy_study, results_folder, capsys):
    """Cases are computed all the same: the tasks only save time."""
    assert toy_study.exists()
    toy_cases = [case for section in ("1", "2") for case in load_section(section).cases]
    tasks = runner.WorkerTaskFunctions("json:no_such_function", "json:dumps")
    assert runner.run_cases_without_valid_result(toy_cases, results_folder, 2, False, tasks) == []
    assert "preparations of parallel tasks: AttributeError" in capsys.readouterr().err


def test_figures_are_drawn_in_the_results_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert draw_outdated_figures(Path("some/results"), require_all_results=False)
    assert json.loads((tmp_path / "some/results/figures/index.json").read_text()) == []


def forget_imported_sections(toy_study):
    """Remove the toy sections from the import caches, so that changed sources are read."""
    for name in [name for name in sys.modules if name.split(".")[0] == "toy"]:
        del sys.modules[name]
    for cache in (toy_study / "toy").glob("__pycache__"):
        for path in cache.iterdir():
            path.unlink()


def test_a_valid_result_survives_a_failed_run_with_force(
    run_study, toy_study, results_folder, capsys
):
    run_study("1")
    old_result = (results_folder / "1" / "b.json").read_text()
    (toy_study / "log").unlink()
    (toy_study / "log").mkdir()  # the sources are unchanged, but now every case of section 1 fails
    assert run_study("1", "--force") == 1
    assert (results_folder / "1" / "b.json").read_text() == old_result
    assert capsys.readouterr().err.count("its stored result still holds and is kept") == 2


def test_only_the_named_cases_are_computed(run_study, toy_study, results_folder, capsys):
    assert run_study("1/b", "2") == 0
    assert count_started_runs(toy_study) == 1
    assert sorted(
        str(path.relative_to(results_folder)) for path in results_folder.rglob("*.json")
    ) == [
        "1/b.json",
        "2/only.json",
    ]
    capsys.readouterr()
    assert run_study("1/b", "1/c") == 2
    assert capsys.readouterr().err == "study: there is no case 1/c: see ./run study list\n"


def test_a_killed_worker_loses_only_its_own_case(run_study, toy_study, results_folder, capsys):
    replace_in_file(
        toy_study / "toy" / "one.py", 'case("b", 2.5)', 'case("b", 2.5, do="die"), case("c")'
    )
    forget_imported_sections(toy_study)
    assert run_study("1", jobs=2) == 1
    assert "unfinished: 1/b\n" in capsys.readouterr().err
    stored = {
        c.case: (c.scalars["y"], [*c.curves["x"]]) for c in Results(results_folder).section("1")
    }
    assert stored == dict.fromkeys("ac", (2.0, [0.0, 1.0, 2.0]))
    workers = {*(toy_study / "log").read_text().split()}
    assert len(workers) > 1
    assert str(os.getpid()) not in workers


def test_a_full_disk_keeps_valid_results_and_gives_one_line_per_failure(
    run_study, toy_study, results_folder, monkeypatch, capsys
):
    def raise_disk_full(_):
        raise OSError(28, "No space left on device")

    def read_stored_scalars():
        return {result.key: result.scalars for result in Results(results_folder).section("1")}

    assert run_study("1") == 0
    old_scalars = read_stored_scalars()
    capsys.readouterr()
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", raise_disk_full)
        assert run_study("--force") == 2
    lines = capsys.readouterr().err.splitlines()
    failure = r"\d/\w+: failed: OSError: .*No space left on device.*"
    assert sum(bool(re.fullmatch(failure, line)) for line in lines) == 3
    assert re.fullmatch(r"study: .*claims.json: No space left on device", lines[-1])
    # counts the line about reused results, and a line for each of two sections
    assert len(lines) == 7
    assert [path.name for path in results_folder.rglob(".*")] == [".pw-elements"]
    assert (read_stored_scalars(), count_started_runs(toy_study)) == (old_scalars, 4)
    assert (run_study(), count_started_runs(toy_study)) == (0, 4)


@pytest.mark.parametrize("command", ["check", "3 --jobs 2"])
def test_a_closed_output_pipe_gives_status_141_and_no_traceback(tmp_path, command):
    """If the output pipe is closed, the exit status is 141, and there is no traceback.

    The status does not signal success, because the work is incomplete.
    """
    stored = Result({"y": 1.0}, {"y": "1"})
    save(tmp_path, "7.1", "former", stored, {"problem": "toy"}, {})
    line = f"{sys.executable} -m study {command} --out {tmp_path} | true; echo ${{PIPESTATUS[0]}}"
    if command.startswith("3"):
        line = line.replace("|", "2>&1 |")
    process = subprocess.run(["bash", "-c", line], cwd=ROOT, capture_output=True, text=True)
    assert process.stdout == "141\n"
    assert [line for line in process.stderr.splitlines() if not line.startswith("study: of ")] == []


def test_an_interrupt_during_imports_gives_one_line(tmp_path):
    """An interrupt during imports gives a message of one line.

    This holds even if a package converts the interrupt to an ImportError, as some packages do for
    optional dependencies.
    """
    (tmp_path / "toy").mkdir()
    slow = "import os, signal\ntry:\n    os.killpg(0, signal.SIGINT)\n    signal.pause()\n"
    slow += "except KeyboardInterrupt:\n    raise ImportError('take a package') from None\n"
    (tmp_path / "toy" / "__init__.py").write_text(slow)
    code = "import sys; from study.run.cases import SECTIONS; SECTIONS['1'] = 'toy'\n"
    code += "from study.run.supervisor import run_in_supervised_process\n"
    code += "from study.publish.command import main\n"
    code += "sys.exit(run_in_supervised_process(lambda: main(['1', '--out', 'OUT']), 'study'))"
    code = code.replace("OUT", str(tmp_path / "results"))
    command, path = [sys.executable, "-c", code], f"{ROOT}:{tmp_path}"
    with SpawnedCommand(command, tmp_path / "messages", PYTHONPATH=path) as process:
        assert process.wait() == 130
        assert process.read_messages() == [f"study: interrupted by SIGINT; {RESUME_HINTS['study']}"]
        assert process.list_survivors() == []
