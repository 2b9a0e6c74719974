"""The list of what each section was computed with, as results and code say."""

import sys
from importlib import import_module

import pytest

from study.publish.texts import computations
from study.run.store import Result, Results, save


@pytest.fixture
def summary_after_storing_case(tmp_path):
    """A function that stores a case of V1 and returns what the section was computed with."""

    def store_case_and_summarise(parameters, dofs=None, curves=None, record=""):
        name = f"case-{len(list(tmp_path.rglob('*.json')))}"
        provenance = {"record": record} | ({} if dofs is None else {"dofs": dofs})
        result = Result({"y": 1.0}, {"y": "1"}, curves or {})
        save(tmp_path, "V1", name, result, {"element": "pw-T6"} | parameters, provenance)
        return computations.describe_computation(Results(tmp_path), "V1")

    return store_case_and_summarise


def test_summary_gives_fewest_and_most_unknowns_and_each_mesh_size_once(summary_after_storing_case):
    summary_after_storing_case({"divisions": [80, 40]}, dofs=40)
    summary_after_storing_case(
        {"dofs": 900, "divisions": [20, 10]}
    )  # a recorded case keeps them among its parameters
    assert summary_after_storing_case({"divisions": [20, 10]}, dofs=120)[:4] == (
        3,
        0,
        (40, 900),
        ["20 × 10", "80 × 40"],
    )
    assert summary_after_storing_case({"measured": {}}, dofs=120, record="study/run/records.json")[
        :2
    ] == (4, 1)


def test_computed_and_recorded_results_are_counted(summary_after_storing_case, tmp_path):
    summary_after_storing_case({}, dofs=1)
    summary_after_storing_case({}, dofs=1)
    summary_after_storing_case({}, dofs=1, record="study/run/records.json")
    assert computations.count_computed_and_recorded(Results(tmp_path)) == (2, 1)


@pytest.mark.parametrize(
    ("parameters", "curves", "meshes"),
    [
        ({"squares": [8, 2, 4]}, {}, ["2", "4", "8"]),
        ({"elements": 5}, {}, ["5"]),
        ({"sides": [0.25, 0.35]}, {}, ["2.86", "4"]),
        ({}, {"elements": [4.0, 8.0, 16.0]}, ["4", "8", "16"]),
        ({"friction": 0.3}, {"x": [1.0, 2.0]}, []),
    ],
)
def test_mesh_sizes_come_from_parameters_and_series(
    summary_after_storing_case, parameters, curves, meshes
):
    assert summary_after_storing_case(parameters, dofs=1, curves=curves).mesh_sizes == meshes


@pytest.mark.parametrize(
    ("section", "module"),
    [
        ("V13", "study.benchmarks.v13_fluxes.page"),
        ("V14", "study.benchmarks.v14_rubber.page"),
        ("C", "study.benchmarks.c_convergence.statics"),
        ("V2", None),
    ],
)
def test_quadrature_degrees_are_those_that_the_modules_use(section, module):
    degree = import_module(module).DEGREE if module else {}
    expected = {*degree.values()} if isinstance(degree, dict) else {degree}
    assert computations._quadrature_degrees(computations.SECTIONS[section]) == expected


def test_rational_degree_is_the_librarys_quadrature_degree():
    import_module("pw_elements")
    library_degrees = [
        vars(module)["_NON_POLYNOMIAL_QUADRATURE_DEGREE"]
        for name, module in sys.modules.items()
        if name.startswith("pw_elements") and "_NON_POLYNOMIAL_QUADRATURE_DEGREE" in vars(module)
    ]
    assert library_degrees == [computations.NON_POLYNOMIAL_DEGREE]
