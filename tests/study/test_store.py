"""Results on disk: exact, whole or not at all, and clear about what is wrong."""

import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest

from study.run.store import (
    FORMAT,
    CorruptResult,
    MissingResult,
    MissingScalar,
    OutdatedResult,
    Result,
    Results,
    StudyError,
    is_result_file,
    save,
)

KEY = "7.1/pw-T6"
RESULT = Result(
    scalars={"reaction_1": 0.1 + 0.2, "count": np.int64(3), "tiny": np.float64(5e-324)},
    units={"reaction_1": "N", "count": "1", "tiny": "mm"},
    curves={"x": np.array([0.0, math.pi, math.nan]), "nodes": np.arange(6).reshape(2, 3)},
)
PARAMETERS = {"element": "pw-T6", "divisions": [20, 10], "friction": 0.3, "smooth": None}


def number(value=1.0, unit="1", curves=None):
    return Result({"y": value}, {"y": unit}, curves or {})


@pytest.fixture
def stored(tmp_path):
    save(tmp_path, "7.1", "pw-T6", RESULT, PARAMETERS, {"seconds": 1.5, "fingerprint": "f"})
    return tmp_path


def test_what_is_read_is_what_was_saved_and_nothing_else_lies_there(stored):
    read = Results(stored)[KEY]
    assert (read.section, read.case, read.key) == ("7.1", "pw-T6", KEY)
    assert read.scalars == {"reaction_1": 0.1 + 0.2, "count": 3.0, "tiny": 5e-324}
    assert (read.units, read.parameters) == (RESULT.units, PARAMETERS)
    assert read.provenance["seconds"] == 1.5
    for name, curve in RESULT.curves.items():
        np.testing.assert_array_equal(read.curves[name], curve)
        assert read.curves[name].dtype == curve.dtype
    content = json.loads((stored / "7.1" / "pw-T6.json").read_text())
    parts = {"parameters", "scalars", "units", "provenance"}
    assert set(content) == {"format", "section", "case", "digest"} | parts
    assert sorted(os.listdir(stored / "7.1")) == ["pw-T6.json", "pw-T6.npz"]


ODD = {"odd": np.array([{}, None])}
UNITS = {"y": "N", "z": "1"}


@pytest.mark.parametrize(
    ("result", "parameters", "message"),
    [
        *[(number(value), PARAMETERS, r"\by = -?(nan|inf)") for value in (math.nan, -math.inf)],
        (Result({"y": 1.0, "z": 2.0}, {}), PARAMETERS, "numbers without a unit: y, z$"),
        (Result({"y": 1.0, "z": 2.0}, UNITS | {"z": ""}), PARAMETERS, "without a unit: z$"),
        (Result({"y": 1.0, "z": 2.0}, UNITS | {"x": "m"}), PARAMETERS, "units of no number: x$"),
        (number(), {}, "has no parameters$"),
        (number(curves=ODD), PARAMETERS, "odd"),
    ],
)
def test_what_cannot_be_stored_is_refused_by_name(tmp_path, result, parameters, message):
    with pytest.raises(StudyError, match=message):
        save(tmp_path, "7.1", "pw-T6", result, parameters, {})
    assert not list(tmp_path.rglob("*.json"))


def test_results_are_asked_for_by_parameters(stored):
    other = {"element": "galerkin-T6", "divisions": [20, 10], "friction": 0.3}
    save(stored, "7.1", "galerkin-T6", number(), other, {})
    results = Results(stored)

    def found(**parameters):
        return [one.case for one in results.where("7.1", **parameters)]

    assert found() == ["galerkin-T6", "pw-T6"]
    assert found(element="pw-T6") == ["pw-T6"]
    assert found(element=["pw-T6", "galerkin-T6"], friction=0.3) == ["galerkin-T6", "pw-T6"]
    assert found(divisions=(20, 10), smooth=None) == ["pw-T6"]
    assert found(friction=0.4) == found(divisions=[[20, 10]]) == found(mesh=1) == []
    assert results.where("7.6", element="pw-T6") == []


KILLED = """
import os, sys
from pathlib import Path
import numpy as np
from study.run.store import Result, save
real = os.replace
os.replace = lambda a, b: os._exit(9) if str(b).endswith(".json") else real(a, b)
result = Result({"y": 1.0}, {"y": "1"}, {"x": np.zeros(2)})
save(Path(sys.argv[1]), "7.1", "pw-T6", result, {"element": "pw-T6"}, {})
"""


def kill_between_curves_and_numbers(folder):
    done = subprocess.run([sys.executable, "-c", KILLED, str(folder)], check=False)
    assert done.returncode == 9
    assert (folder / "7.1" / "pw-T6.npz").exists()


def test_kill_before_the_numbers_leaves_no_result_and_mixes_none(tmp_path):
    kill_between_curves_and_numbers(tmp_path)
    assert KEY not in Results(tmp_path)
    assert Results(tmp_path).section("7.1") == []
    save(tmp_path, "7.1", "pw-T6", RESULT, PARAMETERS, {})
    kill_between_curves_and_numbers(tmp_path)
    with pytest.raises(CorruptResult, match=r"not of the same run.*study 7\.1/pw-T6$"):
        Results(tmp_path)[KEY]


def test_failed_write_leaves_the_old_result_and_no_litter(stored, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space"):
        save(stored, "7.1", "pw-T6", number(9.0, curves={"x": np.ones(1)}), PARAMETERS, {})
    path = stored / "7.1" / "pw-T6.json"  # in another layout, it has the same numbers
    path.write_text(json.dumps(json.loads(path.read_text()), sort_keys=True))
    assert Results(stored).scalar(KEY, "reaction_1") == 0.1 + 0.2
    assert sorted(os.listdir(stored / "7.1")) == ["pw-T6.json", "pw-T6.npz"]
    monkeypatch.undo()
    save(stored, "7.1", "pw-T6", number(), PARAMETERS, {})
    assert Results(stored).curves(KEY) == {}  # those of the earlier result went with it
    assert os.listdir(stored / "7.1") == ["pw-T6.json"]


EDITED = [
    ('"count": 3.0', '"count": 3.0000000000000004'),
    ('"reaction_1": "N"', '"reaction_1": "kN"'),
    ('"friction": 0.3', '"friction": 0.4'),
    (',\n  "tiny": 5e-324', ""),
    ('"digest": "', '"digest": "0'),
    ('"seconds": 1.5', '"seconds": 1.6'),
    ('"fingerprint": "f"', '"fingerprint": "e"'),
    ('"curves_sha256": "', '"curves_sha256": "0'),
]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        *EDITED,
        ("3.0", "NaN"),
        ("3.0", '"3.0"'),
        ('"units"', '"unit"'),
        ('"parameters"', '"parameter"'),
        ('"case": "pw-T6"', '"case": "pw-Q8"'),
        ('"section": "7.1"', '"section": "7.2"'),
        ('"format": "pw_elements study', '"format": "another study'),
        (".json", b'{"case": "pw-T6"'),
        (".json", b""),
        (".json", b"[1, 2]"),
        (".json", b"\xff\xfe\x00"),
        (".npz", b"no archive"),
        (".npz", None),
    ],
)
def test_damaged_or_edited_result_is_named_with_its_remedy(stored, old, new):
    path = stored / "7.1" / "pw-T6.json"
    if old.startswith("."):
        path = path.with_suffix(old)
        path.unlink() if new is None else path.write_bytes(new)
    else:
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))
    assert KEY in Results(stored)
    with pytest.raises(CorruptResult) as caught:
        Results(stored)[KEY]
    message = str(caught.value)
    assert str(stored / "7.1" / "pw-T6.") in message
    assert message.endswith("run ./run study 7.1/pw-T6")
    assert "\n" not in message
    assert "edited since the run" in message or (old, new) not in EDITED


def test_a_result_in_another_place_is_not_that_of_the_place(stored):
    """Nor if its digest is made anew, as the numbers of a forger would have one."""
    for place in ("7.2/pw-T6", "7.1/pw-Q8"):
        for suffix in (".json", ".npz"):
            copy = stored / f"{place}{suffix}"
            copy.parent.mkdir(exist_ok=True)
            copy.write_bytes((stored / f"{KEY}{suffix}").read_bytes())
        with pytest.raises(CorruptResult, match=r"it is of the case 7\.1/pw-T6"):
            Results(stored)[place]
        edit = {"section": place.partition("/")[0], "case": place.partition("/")[2]}
        content = json.loads((stored / f"{KEY}.json").read_text()) | edit
        (stored / f"{place}.json").write_text(json.dumps(content))
        with pytest.raises(CorruptResult, match="it has been edited"):
            Results(stored)[place]


def test_a_result_of_another_version_is_there_but_outdated(stored):
    path = stored / f"{KEY}.json"
    content = json.loads(path.read_text())
    first = {name: content[name] for name in ("case", "parameters", "scalars", "units")}
    for other in (first | {"provenance": {}}, content | {"format": FORMAT.replace("2", "3")}):
        path.write_text(json.dumps(other))
        assert is_result_file(path)
        assert KEY in Results(stored)
        with pytest.raises(OutdatedResult, match=r"another version: run \./run study 7\.1/pw-T6$"):
            Results(stored)[KEY]
        assert (
            Results(stored).readable_results("7.1"),
            Results(stored).corrupt_results("7.1"),
        ) == ([], {})
    path.write_text('{"case": "pw-T6"}')
    assert not is_result_file(path)


def test_a_section_has_what_can_be_read_and_what_cannot(stored):
    save(stored, "7.1", "galerkin-T6", number(), PARAMETERS, {})
    (stored / f"{KEY}.json").write_text("{")
    results = Results(stored)
    assert [one.case for one in results.readable_results("7.1")] == ["galerkin-T6"]
    assert {*results.corrupt_results("7.1")} == {KEY}
    assert results.corrupt_results("7.1")[KEY].endswith("run ./run study 7.1/pw-T6")
    with pytest.raises(CorruptResult):
        results.section("7.1")


def test_missing_result_or_scalar_is_named(stored):
    assert "7.6/pw-T6" not in Results(stored)
    with pytest.raises(MissingResult, match=r"7\.6/pw-T6\.json: run \./run study 7\.6/pw-T6$"):
        Results(stored)["7.6/pw-T6"]
    with pytest.raises(MissingScalar, match=r"'reaction_9' \(but count, reaction_1, tiny\)"):
        Results(stored).scalar(KEY, "reaction_9")


def test_section_is_sorted_and_ignores_unfinished_files(stored):
    save(stored, "7.1", "galerkin-T6", Result({}, {}), PARAMETERS, {})
    save(stored, "7.6", "other", Result({}, {}), PARAMETERS, {})
    (stored / "7.1" / ".pw-Q8.json.77").write_text("{")
    (stored / "7.1" / ".half.json").write_text("{")
    assert [one.case for one in Results(stored).section("7.1")] == ["galerkin-T6", "pw-T6"]


@pytest.mark.parametrize(
    ("text", "error"), [(None, MissingResult), ("{}", CorruptResult), ("[", CorruptResult)]
)
def test_claims_that_cannot_be_read(tmp_path, text, error):
    if text is not None:
        (tmp_path / "claims.json").write_text(text)
    with pytest.raises(error, match=r"claims\.json.*study report"):
        Results(tmp_path).claims()
