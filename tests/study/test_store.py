"""Test that results are stored exactly and completely, and that errors name file and remedy."""

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

STORED_KEY = "7.1/pw-T6"
STORED_RESULT = Result(
    scalars={"reaction_1": 0.1 + 0.2, "count": np.int64(3), "tiny": np.float64(5e-324)},
    units={"reaction_1": "N", "count": "1", "tiny": "mm"},
    curves={"x": np.array([0.0, math.pi, math.nan]), "nodes": np.arange(6).reshape(2, 3)},
)
STORED_PARAMETERS = {"element": "pw-T6", "divisions": [20, 10], "friction": 0.3, "smooth": None}


def make_result_of_one_scalar(value=1.0, unit="1", curves=None):
    return Result({"y": value}, {"y": unit}, curves or {})


@pytest.fixture
def folder_with_stored_result(tmp_path):
    save(
        tmp_path,
        "7.1",
        "pw-T6",
        STORED_RESULT,
        STORED_PARAMETERS,
        {"seconds": 1.5, "fingerprint": "f"},
    )
    return tmp_path


def test_saved_result_is_read_unchanged_and_leaves_two_files_only(folder_with_stored_result):
    stored_result = Results(folder_with_stored_result)[STORED_KEY]
    assert (stored_result.section, stored_result.case, stored_result.key) == (
        "7.1",
        "pw-T6",
        STORED_KEY,
    )
    assert stored_result.scalars == {"reaction_1": 0.1 + 0.2, "count": 3.0, "tiny": 5e-324}
    assert (stored_result.units, stored_result.parameters) == (
        STORED_RESULT.units,
        STORED_PARAMETERS,
    )
    assert stored_result.provenance["seconds"] == 1.5
    for name, curve in STORED_RESULT.curves.items():
        np.testing.assert_array_equal(stored_result.curves[name], curve)
        assert stored_result.curves[name].dtype == curve.dtype
    content = json.loads((folder_with_stored_result / "7.1" / "pw-T6.json").read_text())
    content_keys = {"parameters", "scalars", "units", "provenance"}
    assert set(content) == {"format", "section", "case", "digest"} | content_keys
    assert sorted(os.listdir(folder_with_stored_result / "7.1")) == ["pw-T6.json", "pw-T6.npz"]


UNSTORABLE_CURVES = {"odd": np.array([{}, None])}
UNITS_OF_TWO_SCALARS = {"y": "N", "z": "1"}


@pytest.mark.parametrize(
    ("result", "parameters", "message"),
    [
        *[
            (make_result_of_one_scalar(value), STORED_PARAMETERS, r"\by = -?(nan|inf)")
            for value in (math.nan, -math.inf)
        ],
        (Result({"y": 1.0, "z": 2.0}, {}), STORED_PARAMETERS, "numbers without a unit: y, z$"),
        (
            Result({"y": 1.0, "z": 2.0}, UNITS_OF_TWO_SCALARS | {"z": ""}),
            STORED_PARAMETERS,
            "without a unit: z$",
        ),
        (
            Result({"y": 1.0, "z": 2.0}, UNITS_OF_TWO_SCALARS | {"x": "m"}),
            STORED_PARAMETERS,
            "units of no number: x$",
        ),
        (make_result_of_one_scalar(), {}, "has no parameters$"),
        (make_result_of_one_scalar(curves=UNSTORABLE_CURVES), STORED_PARAMETERS, "odd"),
    ],
)
def test_error_names_what_cannot_be_stored(tmp_path, result, parameters, message):
    with pytest.raises(StudyError, match=message):
        save(tmp_path, "7.1", "pw-T6", result, parameters, {})
    assert not list(tmp_path.rglob("*.json"))


def test_results_are_selected_by_parameters(folder_with_stored_result):
    other_parameters = {"element": "galerkin-T6", "divisions": [20, 10], "friction": 0.3}
    save(
        folder_with_stored_result,
        "7.1",
        "galerkin-T6",
        make_result_of_one_scalar(),
        other_parameters,
        {},
    )
    results = Results(folder_with_stored_result)

    def find_case_names(**parameters):
        return [selected_result.case for selected_result in results.where("7.1", **parameters)]

    assert find_case_names() == ["galerkin-T6", "pw-T6"]
    assert find_case_names(element="pw-T6") == ["pw-T6"]
    assert find_case_names(element=["pw-T6", "galerkin-T6"], friction=0.3) == [
        "galerkin-T6",
        "pw-T6",
    ]
    assert find_case_names(divisions=(20, 10), smooth=None) == ["pw-T6"]
    assert (
        find_case_names(friction=0.4)
        == find_case_names(divisions=[[20, 10]])
        == find_case_names(mesh=1)
        == []
    )
    assert results.where("7.6", element="pw-T6") == []


KILLED_SAVE_SCRIPT = """
import os, sys
from pathlib import Path
import numpy as np
from study.run.store import Result, save
real = os.replace
os.replace = lambda a, b: os._exit(9) if str(b).endswith(".json") else real(a, b)
result = Result({"y": 1.0}, {"y": "1"}, {"x": np.zeros(2)})
save(Path(sys.argv[1]), "7.1", "pw-T6", result, {"element": "pw-T6"}, {})
"""


def kill_save_between_curves_and_scalars(folder):
    completed = subprocess.run([sys.executable, "-c", KILLED_SAVE_SCRIPT, str(folder)], check=False)
    assert completed.returncode == 9
    assert (folder / "7.1" / "pw-T6.npz").exists()


def test_kill_before_the_scalars_are_written_leaves_no_result_and_no_mixture(tmp_path):
    kill_save_between_curves_and_scalars(tmp_path)
    assert STORED_KEY not in Results(tmp_path)
    assert Results(tmp_path).section("7.1") == []
    save(tmp_path, "7.1", "pw-T6", STORED_RESULT, STORED_PARAMETERS, {})
    kill_save_between_curves_and_scalars(tmp_path)
    with pytest.raises(CorruptResult, match=r"not of the same run.*study 7\.1/pw-T6$"):
        Results(tmp_path)[STORED_KEY]


def test_failed_write_leaves_the_old_result_and_no_other_files(
    folder_with_stored_result, monkeypatch
):
    def raise_disk_full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", raise_disk_full)
    with pytest.raises(OSError, match="No space"):
        save(
            folder_with_stored_result,
            "7.1",
            "pw-T6",
            make_result_of_one_scalar(9.0, curves={"x": np.ones(1)}),
            STORED_PARAMETERS,
            {},
        )
    # another layout of the same numbers is accepted
    path = folder_with_stored_result / "7.1" / "pw-T6.json"
    path.write_text(json.dumps(json.loads(path.read_text()), sort_keys=True))
    assert Results(folder_with_stored_result).scalar(STORED_KEY, "reaction_1") == 0.1 + 0.2
    assert sorted(os.listdir(folder_with_stored_result / "7.1")) == ["pw-T6.json", "pw-T6.npz"]
    monkeypatch.undo()
    save(
        folder_with_stored_result,
        "7.1",
        "pw-T6",
        make_result_of_one_scalar(),
        STORED_PARAMETERS,
        {},
    )
    assert (
        Results(folder_with_stored_result).curves(STORED_KEY) == {}
    )  # the curves of the earlier result were removed with it
    assert os.listdir(folder_with_stored_result / "7.1") == ["pw-T6.json"]


EDITS_THAT_THE_DIGEST_DETECTS = [
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
    ("replaced", "replacement"),
    [
        *EDITS_THAT_THE_DIGEST_DETECTS,
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
def test_error_names_a_damaged_or_edited_result_and_its_remedy(
    folder_with_stored_result, replaced, replacement
):
    path = folder_with_stored_result / "7.1" / "pw-T6.json"
    if replaced.startswith("."):
        path = path.with_suffix(replaced)
        path.unlink() if replacement is None else path.write_bytes(replacement)
    else:
        text = path.read_text()
        assert replaced in text
        path.write_text(text.replace(replaced, replacement))
    assert STORED_KEY in Results(folder_with_stored_result)
    with pytest.raises(CorruptResult) as error_info:
        Results(folder_with_stored_result)[STORED_KEY]
    message = str(error_info.value)
    assert str(folder_with_stored_result / "7.1" / "pw-T6.") in message
    assert message.endswith("run ./run study 7.1/pw-T6")
    assert "\n" not in message
    assert (
        "edited since the run" in message
        or (replaced, replacement) not in EDITS_THAT_THE_DIGEST_DETECTS
    )


def test_copy_of_a_result_is_refused_as_another_case(folder_with_stored_result):
    """An exact copy under another key still names the original case and is refused.

    If section and case are edited too, the digest no longer matches, and the error states this.
    """
    for other_key in ("7.2/pw-T6", "7.1/pw-Q8"):
        for suffix in (".json", ".npz"):
            copy = folder_with_stored_result / f"{other_key}{suffix}"
            copy.parent.mkdir(exist_ok=True)
            copy.write_bytes((folder_with_stored_result / f"{STORED_KEY}{suffix}").read_bytes())
        with pytest.raises(CorruptResult, match=r"it is of the case 7\.1/pw-T6"):
            Results(folder_with_stored_result)[other_key]
        other_section_and_case = {
            "section": other_key.partition("/")[0],
            "case": other_key.partition("/")[2],
        }
        content = (
            json.loads((folder_with_stored_result / f"{STORED_KEY}.json").read_text())
            | other_section_and_case
        )
        (folder_with_stored_result / f"{other_key}.json").write_text(json.dumps(content))
        with pytest.raises(CorruptResult, match="it has been edited"):
            Results(folder_with_stored_result)[other_key]


def test_result_in_another_format_version_exists_but_is_outdated(folder_with_stored_result):
    path = folder_with_stored_result / f"{STORED_KEY}.json"
    content = json.loads(path.read_text())
    first_format_content = {
        name: content[name] for name in ("case", "parameters", "scalars", "units")
    }
    for other_format_content in (
        first_format_content | {"provenance": {}},
        content | {"format": FORMAT.replace("2", "3")},
    ):
        path.write_text(json.dumps(other_format_content))
        assert is_result_file(path)
        assert STORED_KEY in Results(folder_with_stored_result)
        with pytest.raises(OutdatedResult, match=r"another version: run \./run study 7\.1/pw-T6$"):
            Results(folder_with_stored_result)[STORED_KEY]
        assert (
            Results(folder_with_stored_result).readable_results("7.1"),
            Results(folder_with_stored_result).error_messages_of_corrupt_results("7.1"),
        ) == ([], {})
    path.write_text('{"case": "pw-T6"}')
    assert not is_result_file(path)


def test_section_separates_readable_and_corrupt_results(folder_with_stored_result):
    save(
        folder_with_stored_result,
        "7.1",
        "galerkin-T6",
        make_result_of_one_scalar(),
        STORED_PARAMETERS,
        {},
    )
    (folder_with_stored_result / f"{STORED_KEY}.json").write_text("{")
    results = Results(folder_with_stored_result)
    assert [readable_result.case for readable_result in results.readable_results("7.1")] == [
        "galerkin-T6"
    ]
    assert {*results.error_messages_of_corrupt_results("7.1")} == {STORED_KEY}
    assert results.error_messages_of_corrupt_results("7.1")[STORED_KEY].endswith(
        "run ./run study 7.1/pw-T6"
    )
    with pytest.raises(CorruptResult):
        results.section("7.1")


def test_error_names_a_missing_result_or_scalar(folder_with_stored_result):
    assert "7.6/pw-T6" not in Results(folder_with_stored_result)
    with pytest.raises(MissingResult, match=r"7\.6/pw-T6\.json: run \./run study 7\.6/pw-T6$"):
        Results(folder_with_stored_result)["7.6/pw-T6"]
    with pytest.raises(MissingScalar, match=r"'reaction_9' \(but count, reaction_1, tiny\)"):
        Results(folder_with_stored_result).scalar(STORED_KEY, "reaction_9")


def test_section_is_sorted_and_ignores_unfinished_files(folder_with_stored_result):
    save(folder_with_stored_result, "7.1", "galerkin-T6", Result({}, {}), STORED_PARAMETERS, {})
    save(folder_with_stored_result, "7.6", "other", Result({}, {}), STORED_PARAMETERS, {})
    (folder_with_stored_result / "7.1" / ".pw-Q8.json.77").write_text("{")
    (folder_with_stored_result / "7.1" / ".half.json").write_text("{")
    assert [
        stored_result.case for stored_result in Results(folder_with_stored_result).section("7.1")
    ] == [
        "galerkin-T6",
        "pw-T6",
    ]


@pytest.mark.parametrize(
    ("text", "error"), [(None, MissingResult), ("{}", CorruptResult), ("[", CorruptResult)]
)
def test_unreadable_claims_raise_an_error_with_its_remedy(tmp_path, text, error):
    if text is not None:
        (tmp_path / "claims.json").write_text(text)
    with pytest.raises(error, match=r"claims\.json.*study report"):
        Results(tmp_path).claims()
