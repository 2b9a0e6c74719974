"""Test each section's summary of results, unknowns, meshes and quadrature degrees."""

import sys
from importlib import import_module

import pytest

from study.publish.texts import computations
from study.run.store import Result, Results, save


@pytest.fixture
def store_v1_case_and_describe(tmp_path):
    """Return a function that stores a case of section V1 and returns the section's summary."""

    def store_case_and_summarise(parameters, dofs=None, curves=None, record=""):
        name = f"case-{len(list(tmp_path.rglob('*.json')))}"
        provenance = {"record": record} | ({} if dofs is None else {"dofs": dofs})
        result = Result({"y": 1.0}, {"y": "1"}, curves or {})
        save(tmp_path, "V1", name, result, {"element": "pw-T6"} | parameters, provenance)
        return computations.describe_computation_of_section(Results(tmp_path), "V1")

    return store_case_and_summarise


def test_summary_has_result_counts_range_of_unknowns_and_distinct_mesh_sizes(
    store_v1_case_and_describe,
):
    store_v1_case_and_describe({"divisions": [80, 40]}, dofs=40)
    store_v1_case_and_describe(
        {"dofs": 900, "divisions": [20, 10]}
    )  # a recorded case has its number of unknowns among the parameters
    assert store_v1_case_and_describe({"divisions": [20, 10]}, dofs=120)[:4] == (
        3,
        0,
        (40, 900),
        ["20 × 10", "80 × 40"],
    )
    assert store_v1_case_and_describe({"measured": {}}, dofs=120, record="study/run/records.json")[
        :2
    ] == (4, 1)


def test_computed_and_recorded_results_are_counted_separately(store_v1_case_and_describe, tmp_path):
    store_v1_case_and_describe({}, dofs=1)
    store_v1_case_and_describe({}, dofs=1)
    store_v1_case_and_describe({}, dofs=1, record="study/run/records.json")
    assert computations.count_computed_and_recorded_results(Results(tmp_path)) == (2, 1)


@pytest.mark.parametrize(
    ("parameters", "curves", "expected_mesh_sizes"),
    [
        ({"squares": [8, 2, 4]}, {}, ["2", "4", "8"]),
        ({"elements": 5}, {}, ["5"]),
        ({"sides": [0.25, 0.35]}, {}, ["2.86", "4"]),
        ({}, {"elements": [4.0, 8.0, 16.0]}, ["4", "8", "16"]),
        ({"friction": 0.3}, {"x": [1.0, 2.0]}, []),
    ],
)
def test_mesh_sizes_are_read_from_parameters_and_curves(
    store_v1_case_and_describe, parameters, curves, expected_mesh_sizes
):
    assert (
        store_v1_case_and_describe(parameters, dofs=1, curves=curves).mesh_sizes
        == expected_mesh_sizes
    )


@pytest.mark.parametrize(
    ("section", "module"),
    [
        ("V13", "study.benchmarks.v13_fluxes.page"),
        ("V14", "study.benchmarks.v14_rubber.page"),
        ("C", "study.benchmarks.c_convergence.statics"),
        ("V2", None),
    ],
)
def test_listed_quadrature_degrees_are_the_degree_constants_of_the_modules(section, module):
    degree = import_module(module).DEGREE if module else {}
    expected = {*degree.values()} if isinstance(degree, dict) else {degree}
    assert (
        computations._find_quadrature_degrees_set_by_section(computations.SECTIONS[section])
        == expected
    )


def test_degree_for_non_polynomials_is_that_of_the_library():
    import_module("pw_elements")
    library_degrees = [
        vars(module)["_NON_POLYNOMIAL_QUADRATURE_DEGREE"]
        for name, module in sys.modules.items()
        if name.startswith("pw_elements") and "_NON_POLYNOMIAL_QUADRATURE_DEGREE" in vars(module)
    ]
    assert library_degrees == [computations.NON_POLYNOMIAL_DEGREE]
