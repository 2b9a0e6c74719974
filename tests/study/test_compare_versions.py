import pytest

from study.run import compare_versions
from study.run.compare_versions import (
    KINDS,
    compare_scalars_of_folders,
    find_kind_of_scalar,
    format_differences,
    main,
)
from study.run.store import Result, Results, save

DEFAULT_SCALARS = {"x": 2.0, "force_normal": 1000.0, "force_tangential": 1e-9, "residual": 1e-12}


@pytest.fixture
def store_scalars(tmp_path, monkeypatch):
    """Return a function that stores a result with the given scalars and returns its folder.

    The folder's name is also stored as the version of DOLFINx.
    """
    monkeypatch.setattr(compare_versions, "SECTIONS", {"1": "", "C": ""})

    def store(folder, key="1/a", **scalars):
        section, case = key.split("/")
        provenance = {"versions": {"dolfinx": folder, "petsc": "3"}}
        numbers = DEFAULT_SCALARS | scalars
        result = Result(numbers, dict.fromkeys(numbers, "1"))
        save(tmp_path / folder, section, case, result, {"problem": "toy"}, provenance)
        return str(tmp_path / folder)

    return store


def compare_folders(*folders):
    return compare_scalars_of_folders(*map(Results, folders))


def test_equal_results_do_not_differ_and_missing_results_are_no_agreement(
    store_scalars, capsys, tmp_path
):
    assert main([str(tmp_path), str(tmp_path)]) == 1
    folders = store_scalars("0.9"), store_scalars("0.11")
    assert main(list(folders)) == 0
    printed = capsys.readouterr().out
    assert "DOLFINx 0.9, PETSc 3" in printed
    assert "4 scalars: 0 differ" in printed


@pytest.mark.parametrize(
    ("name", "value", "is_too_large"),
    [
        ("x", 2.0 * (1 + 0.9e-8), False),
        ("x", 2.0 * (1 + 1.1e-8), True),
        ("force_tangential", -9e-6, False),  # relative to the normal force
        ("force_tangential", 1.1e-5, True),
        ("residual", 0.9e-7, False),
        ("residual", 1.1e-7, True),
    ],
)
def test_differences_are_judged_relative_to_the_scale_of_their_kind(
    store_scalars, name, value, is_too_large
):
    folders = store_scalars("0.9"), store_scalars("0.11", **{name: value})
    differences, only_in_one_folder = compare_folders(*folders)
    assert only_in_one_folder == []
    assert [difference.name for difference in differences if difference.too_large] == [
        name
    ] * is_too_large
    assert main(list(folders)) == int(is_too_large)
    assert ("TOO LARGE" in format_differences(differences, only_in_one_folder)) is is_too_large


def test_a_change_of_sign_of_a_small_number_is_too_large(store_scalars):
    assert main([store_scalars("0.9", x=1e-12), store_scalars("0.11", x=-1e-12)]) == 1


def test_scalars_and_cases_in_one_folder_only_are_reported(store_scalars):
    folders = store_scalars("0.9", y=1.0), store_scalars("0.11")
    store_scalars("0.11", key="C/b")
    differences, only_in_one_folder = compare_folders(*folders)
    assert only_in_one_folder == ["1/a y", "C/b"]
    assert main(list(folders)) == 1
    assert len(differences) == len(DEFAULT_SCALARS)


@pytest.mark.parametrize(
    ("case_and_scalar_name", "kind"),
    [
        ("C/pw-T10-ball error_L2", "numbers on Gmsh's meshes"),
        ("C/pw-T10-cube error_L2", "errors"),
        ("7.2/pw-T6 force_normal", "forces"),
        ("V12/frequency-square-hrz-fine acceleration_min", "forces"),
        ("Q/seconds-pw-T6-16 variation", "errors"),
        ("W/reference-conductance-T6 answer_uncertainty", "errors"),
        ("V14/punch-galerkin-T6-64 newton_rate", "rates of Newton's method"),
        ("V8/rod-pw-T6 omega2_1_order", "orders"),
        ("V8/rod-pw-T6 omega2_1", "all others"),
        ("V15/cube-pw-hybrid-T10-0.5-6 h1_error", "numbers on Gmsh's tetrahedra"),
        ("V12/frequency-cube-hrz order", "numbers on Gmsh's tetrahedra"),
        ("V12/bar-3d-pw-5 energy_end", "motions that grow"),
        ("V10/punch-pw-T10-4 krylov_iterations", "counts of Krylov's iterations"),
        ("V11/patch-3d-pw-dual balance_force", "residuals and identities"),
        ("V11/patch-3d-pw-dual master_force_min", "errors"),
    ],
)
def test_scalar_has_the_kind_that_its_case_and_name_say(case_and_scalar_name, kind):
    assert find_kind_of_scalar(case_and_scalar_name).name == kind
    assert len({listed_kind.name for listed_kind in KINDS}) == len(KINDS)


def test_a_given_tolerance_replaces_those_of_all_kinds_but_counts(store_scalars, capsys):
    """With `--tolerance 1e-9`, differences relative to the scale of their kind may reach 1e-9.

    With this option, counts of iterations are not compared. Without it, counts are compared, and
    the tolerance of all other scalars is larger, as versions of libraries may differ.
    """
    reference_folder = store_scalars("before", iterations=7.0, iterations_most=3.0)
    within_tolerance = store_scalars(
        "same", iterations=9.0, iterations_most=4.0, x=2.0 * (1 + 0.9e-9)
    )
    beyond_tolerance = store_scalars(
        "other", iterations=7.0, iterations_most=3.0, x=2.0 * (1 + 1.1e-9)
    )
    with_larger_residual = store_scalars(
        "residual", iterations=7.0, iterations_most=3.0, residual=2e-9
    )
    assert main([reference_folder, within_tolerance, "--tolerance", "1e-9"]) == 0
    assert (
        "counts of iterations, and times: 2, largest difference 2.5e-01" in capsys.readouterr().out
    )
    assert main([reference_folder, beyond_tolerance, "--tolerance", "1e-9"]) == 1
    assert main([reference_folder, with_larger_residual, "--tolerance", "1e-9"]) == 1
    assert (
        main([reference_folder, beyond_tolerance]) == 0
    )  # within the tolerance for different versions of libraries
    assert main([reference_folder, within_tolerance]) == 1  # counts of iterations differ
