"""The command line: what is computed, kept and reported, and with which exit status."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

import study.command
import study.report
from study.command import main
from study.core.store import Result, Results, StudyError, save
from study.core.supervisor import KEPT
from tests.run.processes import Started
from tests.study.toystudy import claim, install, started

ROOT = Path(__file__).parents[2]

BUILD = study.report.build

# Debian pairs WeasyPrint with a newer pydyf, which has renamed some methods
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:pydyf")


@pytest.fixture
def toy(tmp_path, monkeypatch):
    install(tmp_path, monkeypatch)
    monkeypatch.setattr(study.report, "build", lambda *_: [])
    return tmp_path


@pytest.fixture
def report(toy, monkeypatch):
    """Let the report be written, which is slow and not the matter of most tests here."""
    assert toy
    monkeypatch.setattr(study.report, "build", BUILD)
    # its texts are about the real sections
    monkeypatch.setattr(study.report._Paper, "_body", lambda *_: "text")


@pytest.fixture
def out(toy):
    return toy / "results"


@pytest.fixture
def run(out):
    def start(*arguments, jobs=1):
        return main([*arguments, "--jobs", str(jobs), "--out", str(out)])

    return start


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.usefixtures("report")
def test_whole_study_leaves_everything(run, out, capsys):
    assert run() == 0
    printed = capsys.readouterr()
    assert {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()} == {
        "1/a.json", "1/a.npz", "1/b.json", "1/b.npz", "2/only.json",
        "claims.json", "figures/index.json", "report.html", "report.pdf", ".pw-elements",
    }  # fmt: skip
    first, one, two = printed.err.splitlines()
    assert first == "0 of 3 results are reused; 3 to be computed"
    assert re.fullmatch(r"1    First toy: 2 computed in \d\.\d s", one)
    assert re.fullmatch(r"2    Second toy: 1 computed in \d\.\d s", two)
    assert "1 statements of the paper: 1 reproduced; 0 other than pinned" in printed.out
    assert str(out / "report.html") in printed.out


def test_what_is_computed_again(run, toy, out, capsys):
    assert run("1") == 0
    assert started(toy) == 2
    capsys.readouterr()
    assert run("1") == 0
    assert (started(toy), capsys.readouterr().err) == (2, "2 of 2 results are reused\n")
    assert run("1", "--force") == 0
    assert started(toy) == 4
    change(toy / "toy" / "common.py", "2.0", 'float("2.0")')
    assert run("1") == 0
    assert (started(toy), Results(out).scalar("1/b", "y")) == (6, 5.0)
    (out / "1" / "a.json").write_text("{")
    assert run("1") == 0
    assert "1/a: its stored result cannot be read" in capsys.readouterr().err
    assert (started(toy), Results(out).scalar("1/a", "y")) == (7, 2.0)
    assert run("2", "--force") == 0  # a subset takes the rest from what is stored
    assert started(toy) == 7
    assert Results(out).claims()[0]["verdict"] == "holds"


def test_recorded_results_are_counted_apart_and_computed_on_demand(
    run, toy, out, monkeypatch, capsys
):
    """A section whose second case is read from a record, as those of the longer series."""
    recorded = 'CASES = [case("a"), replace(case("b", 9.0), record="toy/record.json")]'
    change(toy / "toy" / "one.py", 'CASES = [case("a"), case("b", 2.5)]', recorded)
    change(toy / "toy" / "one.py", "import os", "import os\nfrom dataclasses import replace")
    computed = ModuleType("study.verification.longer")
    monkeypatch.setitem(sys.modules, "study.verification.longer", computed)
    computed.CASES = {}
    (section,) = study.command._load(["1"])
    computed.CASES["1/b"] = replace(
        section.cases[0], name="b", parameters={"value": 2.5, "log": ""}
    )
    computed.CASES["1/b"].parameters["log"] = str(toy / "log")

    def told():
        return [re.sub(r"\d\.\d s", "# s", line) for line in capsys.readouterr().err.splitlines()]

    assert run("1") == 1  # 18 is not 5
    assert told() == [
        "0 of 2 results are reused; 1 to be computed; 1 to be read from tracked records",
        "1    First toy: 1 computed in # s, 1 read from tracked records",
    ]
    assert Results(out)["1/b"].record == "toy/record.json"
    assert not Results(out)["1/a"].record
    with pytest.raises(StudyError, match=r"1/b has no curves: it is read from toy/record\.json"):
        Results(out).curves("1/b")
    assert len(Results(out).curves("1/a")["x"]) == 3
    assert run("1", "--all") == 0
    assert told() == [
        "1 of 2 results are reused; 1 to be computed",
        "1    First toy: 1 computed in # s",
    ]
    assert Results(out).scalar("1/b", "y") == 5.0
    assert not Results(out)["1/b"].record
    assert run("1") == 0  # what has been computed stays
    assert told() == ["2 of 2 results are reused"]


def test_verdicts_of_other_sections_are_not_told(run, toy, capsys):
    other = claim(id='"other"', args='{ key = "2/only", name = "z" }', value="8.0")
    (toy / "claims.toml").write_text(claim() + other)
    assert run("1") == 0
    assert capsys.readouterr().out.startswith("1 statements of the paper: 1 reproduced; 0 other")
    assert run("2") == 1
    assert capsys.readouterr().out.splitlines()[0].startswith("other  7  = 8 ± 1e-12")
    assert run("1") == 0
    assert "other" not in capsys.readouterr().out.splitlines()[0].split(";")[0]
    assert run() == 1


def test_result_of_a_case_that_is_no_more_is_removed(run, out):
    save(out, "1", "former", Result({"y": 1.0}, {"y": "1"}), {"problem": "toy"}, {})
    assert run("2") == 0
    assert Results(out).cases("1") == ["former"]
    assert run("1") == 0
    assert Results(out).cases("1") == ["a", "b"]


@pytest.mark.usefixtures("report")
def test_incomplete_report_is_1_after_the_whole_only(run, monkeypatch, capsys):
    monkeypatch.setattr("study.report.build", lambda *_: ["section 1: no such result"])
    assert run("1") == 0
    assert "incomplete" not in capsys.readouterr().err
    assert run() == 1
    assert "report: incomplete, section 1: no such result" in capsys.readouterr().err


def test_differing_verdict_is_1_and_shown(run, toy, capsys):
    shown = re.compile(r"^the-claim  5  = 4 .*fails, pinned: holds$", re.M)
    change(toy / "claims.toml", "value = 5.0", "value = 4.0")
    for command in ("1", "check", "report"):
        assert run(command) == 1
        assert shown.search(capsys.readouterr().out) or command == "report"
    found = claim(value="4.0", grade='"contradicted"', found="5.0", found_tol="0.1")
    (toy / "claims.toml").write_text(found)
    assert run("check") == run("report") == 0
    change(toy / "claims.toml", "found = 5.0", "found = 5.5")
    assert run("check") == 1


def test_missing_verdict_fails_the_whole_and_the_check_but_no_subset(run, toy, capsys):
    change(toy / "claims.toml", "1/b", "1/never")
    assert run("1") == 0
    assert "1 not judged" in capsys.readouterr().out
    assert [run(*command) for command in (["report"], [], ["check"])] == [0, 1, 1]
    assert "not judged, pinned: holds" in capsys.readouterr().out


def test_case_that_raises_leaves_the_others_and_no_result(run, toy, out, capsys):
    run("1")
    before = (out / "1" / "b.json").read_text()
    change(toy / "toy" / "one.py", 'case("a")', 'case("a", do="raise")')
    forget(toy)
    assert run("1", "--force") == 1
    errors, results = capsys.readouterr().err, Results(out)
    words = r"1/a: failed: ArithmeticError: no convergence \(one\.py, line \d+\)$"
    assert re.search(words, errors, re.M)
    assert "second line" not in errors
    assert "1/a" not in results
    assert results.scalar("1/b", "y") == 5.0
    assert (out / "1" / "b.json").read_text() != before


@pytest.mark.parametrize("command", ["report", "check"])
@pytest.mark.parametrize("damage", ["{", "", "[" * 100_000, "another section's"])
def test_corrupt_result_costs_its_own_verdicts_only(run, toy, out, capsys, command, damage):
    """It has a status of its own, and what mends it is said, case by case."""
    other = claim(id='"other"', args='{ key = "2/only", name = "z" }', value="7.0")
    wrong = claim(id='"wrong"', value="4.0")
    (toy / "claims.toml").write_text(claim() + other + wrong)
    assert run() == 1
    capsys.readouterr()
    path = out / "2" / "only.json"
    text = (out / "1" / "b.json").read_text() if damage.startswith("another") else damage
    path.write_text(text)
    assert run(command) == 3
    printed = capsys.readouterr()
    assert "study: of 3 results 1 is corrupt: 2/only; run ./run study 2/only\n" in printed.err
    assert f"study: other is not judged: {path} cannot be used" in printed.err
    assert "3 reproduced; 1 not judged; 1 other than pinned" in printed.out
    assert "wrong  5  = 4" in printed.out
    verdicts = {row["id"]: row["verdict"] for row in Results(out).claims()}
    if command == "report":
        assert verdicts == {"the-claim": "holds", "other": "not judged", "wrong": "fails"}
    assert run("2/only") == 0
    assert run(command) == 1  # wrong
    assert "corrupt" not in capsys.readouterr().err


def test_a_missing_scalar_is_no_crash_of_the_check(run, toy, capsys):
    other = claim(id='"other"', args='{ key = "2/only", name = "no" }')
    (toy / "claims.toml").write_text(claim() + other)
    assert run() == 1
    printed = capsys.readouterr()
    assert "study: other is not judged: " in printed.err
    assert "has no scalar 'no' (but z): run ./run study 2/only --force" in printed.err
    assert "other" in printed.out


def test_files_that_are_no_results_stay_in_a_section_and_are_named(run, out, capsys):
    run("1")
    for name in ("notes", "broken"):
        (out / "1" / f"{name}.json").write_text('{"mine": 1}')
    (out / "1" / "notes.npz").write_text("mine")
    capsys.readouterr()
    assert run("check") == 3
    said = capsys.readouterr().err
    for name in ("notes", "broken"):
        path = out / "1" / f"{name}.json"
        assert f"study: {path} is the result of no case, and cannot be read: move it" in said
    assert run("1") == 3
    assert f"{out / '1' / 'broken.json'} is the result of no case" in capsys.readouterr().err
    assert {path.stem for path in (out / "1").iterdir()} == {"a", "b", "notes", "broken"}


def test_a_folder_in_the_place_of_a_file_is_one_sentence(run, out, capsys):
    assert run("1") == 0
    (out / "claims.json").unlink()
    (out / "claims.json" / "mine").mkdir(parents=True)
    capsys.readouterr()
    assert run("report") == 2
    assert capsys.readouterr().err.endswith("claims.json is no regular file: it is not replaced\n")
    assert (out / "claims.json" / "mine").is_dir()


@pytest.mark.parametrize("command", ["1", "1/b", "report", ""])
def test_a_folder_of_someone_else_is_not_written_in(run, out, capsys, command):
    """Even if it has a name of the study's, and a result in it."""
    (out / "1").mkdir(parents=True)
    for name in ("claims.json", "1/a.json", "1/former.json", "letter.txt"):
        (out / name).write_text('{"mine": 1}')
    save(out, "2", "only", Result({"y": 1.0}, {"y": "1"}), {"problem": "toy"}, {})
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert run(*command.split()) == 2
    said = capsys.readouterr().err
    assert f"study: {out} is not empty, and does not say that it is a folder of results" in said
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def test_results_of_an_earlier_version_are_known_outdated_and_computed_again(run, toy, out, capsys):
    run("1")
    (out / ".pw-elements").unlink()
    for case in "ab":
        path = out / "1" / f"{case}.json"
        content = json.loads(path.read_text())
        keys = ("case", "parameters", "scalars", "units", "provenance")
        path.write_text(json.dumps({key: content[key] for key in keys}))
    capsys.readouterr()
    assert run("check") == 1
    assert "of 3 results 2 are outdated: 1/a, 1/b; run ./run study 1/a 1/b\n" in (
        capsys.readouterr().err
    )
    assert started(toy) == 2
    assert run("1") == 0
    assert started(toy) == 4


@pytest.mark.usefixtures("report")
def test_report_restores_what_was_lost(run, out):
    run()
    for name in ("claims.json", "report.html", "report.pdf", "figures/index.json"):
        (out / name).unlink()
    assert run("report") == 0
    assert (out / "report.pdf").read_bytes().startswith(b"%PDF")
    assert Results(out).claims()[0]["verdict"] == "holds"


def test_list_tells_the_state_of_each_case(run, toy, out, capsys):
    run("1")
    (out / "1" / "a.json").write_text("{")
    capsys.readouterr()
    assert run("list") == 0
    words = "1  First toy|    corrupt   1/a|    stored    1/b|2  Second toy|    missing   2/only|"
    assert capsys.readouterr().out.split("\n") == words.split("|")
    change(toy / "toy" / "common.py", "2.0", "3.0")
    run("list")
    assert "    outdated  1/b" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["check", "report"])
def test_what_only_reads_tells_what_is_outdated_or_missing(run, toy, out, capsys, command):
    run()
    capsys.readouterr()
    assert run(command) == 0
    assert "outdated" not in (said := capsys.readouterr().err)
    assert "missing" not in said
    change(toy / "toy" / "one.py", "FACTOR * value", "value * FACTOR")
    (out / "2" / "only.json").unlink()
    assert run(command) == 0
    assert capsys.readouterr().err.splitlines()[:2] == [
        "study: of 3 results 2 are outdated: 1/a, 1/b; run ./run study 1/a 1/b",
        "study: of 3 results 1 is missing: 2/only; run ./run study 2/only",
    ]
    change(toy / "toy" / "one.py", "value * FACTOR", "FACTOR * value")
    change(toy / "toy" / "one.py", "CASES =", "# what is computed\nCASES =")
    assert run(command) == 0
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
def test_bad_usage_is_2_and_one_sentence_before_any_work(
    toy, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(toy)
    assert main(arguments) == 2
    errors = capsys.readouterr().err
    assert errors.startswith(f"study: {message}")
    assert errors.count("\n") == 1
    assert started(toy) == 0


def test_mistake_in_the_claims_is_noticed_before_any_work(run, toy, capsys):
    (toy / "claims.toml").write_text(claim(relation='"~"'))
    assert run("1") == 2
    assert "claim the-claim: relation" in capsys.readouterr().err
    assert started(toy) == 0


@pytest.mark.usefixtures("report")
def test_figures_that_fail_are_1_and_do_not_cost_the_report(run, out, monkeypatch):
    draw = study.command.draw_figures
    monkeypatch.setattr(study.command, "draw_figures", lambda *given: not draw(*given))
    assert run("1") == 1
    assert (out / "report.html").exists()


def test_figures_are_drawn_where_the_results_are(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert study.command.draw_figures(Path("some/results"), complete=False)
    assert json.loads((tmp_path / "some/results/figures/index.json").read_text()) == []


def forget(toy):
    """Let the next import read the section's changed source."""
    for name in [name for name in sys.modules if name.split(".")[0] == "toy"]:
        del sys.modules[name]
    for cache in (toy / "toy").glob("__pycache__"):
        for path in cache.iterdir():
            path.unlink()


def test_valid_result_outlives_a_failed_run_with_force(run, toy, out, capsys):
    run("1")
    before = (out / "1" / "b.json").read_text()
    (toy / "log").unlink()
    (toy / "log").mkdir()  # the same sources, but every case of section 1 fails now
    assert run("1", "--force") == 1
    assert (out / "1" / "b.json").read_text() == before
    assert capsys.readouterr().err.count("its stored result still holds and is kept") == 2


def test_single_cases_are_computed_and_nothing_else(run, toy, out, capsys):
    assert run("1/b", "2") == 0
    assert started(toy) == 1
    assert sorted(str(path.relative_to(out)) for path in out.rglob("*.json")) == [
        "1/b.json",
        "2/only.json",
    ]
    capsys.readouterr()
    assert run("1/b", "1/c") == 2
    assert capsys.readouterr().err == "study: there is no case 1/c: see ./run study list\n"


def test_killed_worker_costs_its_own_case_only(run, toy, out, capsys):
    change(toy / "toy" / "one.py", 'case("b", 2.5)', 'case("b", 2.5, do="die"), case("c")')
    forget(toy)
    assert run("1", jobs=2) == 1
    assert "unfinished: 1/b\n" in capsys.readouterr().err
    found = {c.case: (c.scalars["y"], [*c.curves["x"]]) for c in Results(out).section("1")}
    assert found == dict.fromkeys("ac", (2.0, [0.0, 1.0, 2.0]))
    workers = {*(toy / "log").read_text().split()}
    assert len(workers) > 1
    assert str(os.getpid()) not in workers


def test_full_disk_keeps_what_holds_and_is_told_in_a_line_each(run, toy, out, monkeypatch, capsys):
    def full(_):
        raise OSError(28, "No space left on device")

    def stored():
        return {one.key: one.scalars for one in Results(out).section("1")}

    assert run("1") == 0
    before = stored()
    capsys.readouterr()
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        assert run("--force") == 2
    lines = capsys.readouterr().err.splitlines()
    failed = r"\d/\w+: failed: OSError: .*No space left on device.*"
    assert sum(bool(re.fullmatch(failed, line)) for line in lines) == 3
    assert re.fullmatch(r"study: .*claims.json: No space left on device", lines[-1])
    assert len(lines) == 7  # and what is reused, and a line for each of two sections
    assert [path.name for path in out.rglob(".*")] == [".pw-elements"]
    assert (stored(), started(toy)) == (before, 4)
    assert (run(), started(toy)) == (0, 4)


@pytest.mark.parametrize("command", ["check", "3 --jobs 2"])
def test_reader_that_leaves_is_no_crash(tmp_path, command):
    """Nor a success: what was to be computed or judged has not been, or is not told."""
    stored = Result({"y": 1.0}, {"y": "1"})
    save(tmp_path, "7.1", "former", stored, {"problem": "toy"}, {})
    line = f"{sys.executable} -m study {command} --out {tmp_path} | true; echo ${{PIPESTATUS[0]}}"
    if command.startswith("3"):
        line = line.replace("|", "2>&1 |")
    done = subprocess.run(["bash", "-c", line], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "141\n"
    assert [line for line in done.stderr.splitlines() if not line.startswith("study: of ")] == []


def test_interrupt_while_importing_is_one_line(tmp_path):
    """Packages may take it for a part of theirs that is missing."""
    (tmp_path / "toy").mkdir()
    slow = "import os, signal\ntry:\n    os.killpg(0, signal.SIGINT)\n    signal.pause()\n"
    slow += "except KeyboardInterrupt:\n    raise ImportError('take a package') from None\n"
    (tmp_path / "toy" / "__init__.py").write_text(slow)
    code = "import sys; from study.core.cases import SECTIONS; SECTIONS['1'] = 'toy'\n"
    code += "from study.core.supervisor import supervise; from study.command import main\n"
    code += "sys.exit(supervise(lambda: main(['1', '--out', 'OUT']), 'study'))"
    code = code.replace("OUT", str(tmp_path / "results"))
    command, path = [sys.executable, "-c", code], f"{ROOT}:{tmp_path}"
    with Started(command, tmp_path / "messages", PYTHONPATH=path) as run:
        assert run.wait() == 130
        assert run.lines() == [f"study: interrupted by SIGINT; {KEPT['study']}"]
        assert run.left() == []
