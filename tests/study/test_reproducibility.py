"""Test the data that reproducing the study needs: digest of numbers, versions, times, licence."""

import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from study.publish import reproducibility
from study.publish.report import _ReportRenderer
from study.publish.reproducibility import (
    ComputingTime,
    digest_scalars_and_curves,
    list_commits,
    read_blas_version,
    read_citation,
    read_mumps_version,
    read_stored_versions,
    read_versions_not_stored_with_results,
    sum_computing_time,
)
from study.publish.texts import TEXTS_FOLDER
from study.run.store import Result, Results, save
from tests.study.toystudy import (
    TOY_PARAMETERS,
    TOY_PROVENANCE,
    install_toy_study,
    write_toy_results,
)

RESULTS_FOLDER = Path(__file__).parents[2] / "results"
SCALARS = {"y": 1.5, "z": -0.0, "cpu_seconds": 2.0}
CURVES = {"x": [1.0, 2.0, np.nan], "n": [[1, 2], [3, 4]], "names": ["a", "b"]}


@pytest.fixture
def save_and_digest_result(tmp_path, monkeypatch):
    """Return a function that stores two results in a new folder and returns their joint digest.

    The first result is always the same; the second one is made from the arguments.
    """
    install_toy_study(tmp_path, monkeypatch)

    def save_and_digest(scalars=SCALARS, curves=CURVES, case="b", **provenance):
        folder = tmp_path / f"results-{len(list(tmp_path.glob('results-*')))}"
        for name, result_scalars, result_curves in (("a", {"y": 7.0}, {}), (case, scalars, curves)):
            units = dict.fromkeys(result_scalars, "1")
            arrays = {key: np.array(curve) for key, curve in result_curves.items()}
            result = Result(result_scalars, units, arrays)
            save(folder, "1", name, result, TOY_PARAMETERS, TOY_PROVENANCE | provenance)
        return digest_scalars_and_curves(Results(folder))

    return save_and_digest


def test_the_digest_depends_on_numbers_alone(save_and_digest_result):
    digest = save_and_digest_result()
    assert re.fullmatch(r"[0-9a-f]{64}", digest)
    reordered = dict(reversed(SCALARS.items())), dict(reversed(CURVES.items()))
    as_floats = CURVES | {"n": np.array(CURVES["n"], dtype=float)}
    digests_of_equal_numbers = [
        save_and_digest_result(),
        save_and_digest_result(*reordered),
        save_and_digest_result(curves=as_floats),
        save_and_digest_result(SCALARS | {"z": 0.0}),
        save_and_digest_result(SCALARS | {"cpu_seconds": 3.0}),
        save_and_digest_result(seconds=99.0, time="2027-01-01T00:00:00+00:00", commit="f" * 16),
        save_and_digest_result(versions={"dolfinx": "1.0"}, fingerprint="g"),
    ]
    assert digests_of_equal_numbers == [digest] * len(digests_of_equal_numbers)


def test_the_digest_changes_with_each_number_and_name(save_and_digest_result):
    digests = [
        save_and_digest_result(),
        save_and_digest_result(SCALARS | {"y": np.nextafter(1.5, 2.0)}),
        save_and_digest_result({"w": 1.5, "z": 0.0}),
        save_and_digest_result(case="c"),
        save_and_digest_result(curves=CURVES | {"x": [1.0, 2.0, 3.0]}),
        save_and_digest_result(curves=CURVES | {"x": [2.0, 1.0, np.nan]}),
        save_and_digest_result(curves=CURVES | {"n": [1, 2, 3, 4]}),
        save_and_digest_result(curves=CURVES | {"names": ["a", "c"]}),
        save_and_digest_result(curves={}),
    ]
    assert len(set(digests)) == len(digests)


def test_versions_commits_and_time_are_those_of_the_results(tmp_path, monkeypatch):
    results = Results(write_toy_results(tmp_path, monkeypatch))
    assert read_stored_versions(results) == {"DOLFINx": ["0.10.0", "0.9.0"], "NumPy": ["2.2.4"]}
    assert list_commits(results) == ["0123456789", "0123456789+"]
    elapsed_seconds = 2 * TOY_PROVENANCE["processes"] * TOY_PROVENANCE["seconds"]
    assert sum_computing_time(results) == ComputingTime(pytest.approx(elapsed_seconds), 0.0, 2)


def test_versions_of_the_environment_are_identified():
    pytest.importorskip("petsc4py", reason="PETSc is not installed")
    versions = read_versions_not_stored_with_results()
    assert list(versions) == ["MUMPS", "BLAS", "SciPy", "Python"]
    for name in ("MUMPS", "SciPy", "Python"):
        assert re.match(r"\d+\.\d+\.\d+|not identified", versions[name]), (name, versions[name])


def test_mumps_and_blas_versions_are_read_from_files_or_not_identified(tmp_path):
    library = tmp_path / "libdmumps-5.7.so"
    library.write_bytes(b"\0version 5.7.3\0GCC: (Debian 14.2.0-19) 14.2.0\0 2.2.5\0")
    assert read_mumps_version([library]) == "5.7.3"
    library.write_bytes(b"\x005.7.3\x005.6.2\0")
    assert read_mumps_version([library]) == "not identified"
    assert read_mumps_version([]) == read_blas_version([]) == "not identified"
    broken_library = tmp_path / "libopenblasp-r0.3.29.so"
    broken_library.write_bytes(b"")
    assert read_blas_version([broken_library]) == broken_library.name


def test_citation_and_licence_agree_with_their_files():
    citation = read_citation()
    text = (Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8")
    assert f'\ntitle: "{citation["title"]}"\n' in text
    assert f"\nversion: {citation['version']}\n" in text
    assert f"\n  - name: {citation['author']}\n" in text
    licence_text = (Path(__file__).parents[2] / "LICENSE").read_text(encoding="utf-8")
    assert licence_text.startswith(f"{citation['license']} License")
    assert "associated documentation files" in licence_text  # "covers code and documentation alike"


def test_reproducibility_box_shows_command_commits_versions_digest_and_licence(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(reproducibility, "describe_processor", lambda: "Some Processor, 2 cores")
    results = Results(write_toy_results(tmp_path, monkeypatch))
    renderer = _ReportRenderer(results, TEXTS_FOLDER)
    html = str(renderer.render_text("reproducibility"))
    page_text = " ".join(unescape(re.sub("<[^>]+>", " ", html)).split())
    for expected in (
        "./run study",
        "0123456789, 0123456789+ (+: with changes)",
        "DOLFINx 0.10.0 and 0.9.0, NumPy 2.2.4",
        *(f"{name} {version}" for name, version in read_versions_not_stored_with_results().items()),
        "Some Processor, 2 cores",
        digest_scalars_and_curves(results),
        "under the MIT licence",
        "CC BY 4.0: that is a decision of the authors",
        "How to cite.",
    ):
        assert expected in page_text, expected
    assert renderer.missing_content == []


@pytest.mark.skipif(not RESULTS_FOLDER.is_dir(), reason="there are no results")
def test_stored_and_environment_versions_cover_all_libraries():
    versions = (
        read_stored_versions(Results(RESULTS_FOLDER)) | read_versions_not_stored_with_results()
    )
    assert list(versions) == [
        *("DOLFINx", "Basix", "UFL", "FFCx", "PETSc", "SLEPc", "NumPy"),
        *("MUMPS", "BLAS", "SciPy", "Python"),
    ]
